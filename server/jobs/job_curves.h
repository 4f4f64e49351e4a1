// How the jobs that run come along, as metrics.

#ifndef MANEUVER_SERVER_JOBS_JOB_CURVES_H_
#define MANEUVER_SERVER_JOBS_JOB_CURVES_H_

#include <vector>

#include "maneuver/v1/training_service.pb.h"
#include "server/monitoring/metrics.h"

namespace maneuver::jobs {

// By slot, not by job: as many slots as jobs may run at a time, so labels stay few however many
// jobs there are. What nobody has reported, and all of a slot where nothing runs, is NaN. One
// caller at a time for each slot.
class JobCurves {
 public:
  //   slots: counted from 0 here, from 1 in the label.
  JobCurves(monitoring::MetricRegistry& metrics, int slots);

  // Losses and the like are those of the last epoch that was reported.
  void Show(int slot, const v1::JobProgress& progress);
  // The job ended.
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
