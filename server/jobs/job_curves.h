// Shows the progress of running jobs as metrics.

#ifndef MANEUVER_SERVER_JOBS_JOB_CURVES_H_
#define MANEUVER_SERVER_JOBS_JOB_CURVES_H_

#include <vector>

#include "maneuver/v1/training_service.pb.h"
#include "server/monitoring/metrics.h"

namespace maneuver::jobs {

// Metrics are kept by slot, not by job. There are as many slots as jobs may run at a time, so the
// number of labels is limited. Values that are not known, and all values of an unused slot, are
// NaN. Each slot needs one caller at a time.
class JobCurves {
 public:
  //   slots: counted from 0 here, from 1 in the label.
  JobCurves(monitoring::MetricRegistry& metrics, int slots);

  // Shows a progress. Losses and other figures of an epoch stay until the next epoch is reported.
  void Show(int slot, const v1::JobProgress& progress);
  // Clears the slot when its job has ended.
  void Clear(int slot);

 private:
  struct Slot {
    monitoring::Gauge& fraction;
    monitoring::Gauge& examples_per_second;
    monitoring::Gauge& training_loss;
    monitoring::Gauge& validation_loss;
    monitoring::Gauge& log_likelihood;
    monitoring::Gauge& effective_actions;
  };

  std::vector<Slot> slots_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_CURVES_H_
