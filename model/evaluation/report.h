// Gathers measurements of examples into a report.

#ifndef MANEUVER_MODEL_EVALUATION_REPORT_H_
#define MANEUVER_MODEL_EVALUATION_REPORT_H_

#include <span>
#include <vector>

#include "maneuver/v1/training_service.pb.h"
#include "model/evaluation/calibration.h"
#include "model/evaluation/example_metrics.h"
#include "model/evaluation/input_ranges.h"
#include "model/evaluation/measurement.h"
#include "model/evaluation/set_sums.h"

namespace maneuver::evaluation {

// Sums over measurements, from which a report is made; evaluator.h defines its metrics. Its memory
// does not grow with the number of measurements. The last bits of the report depend on the order of
// the measurements and on nothing else.
class ReportSums {
 public:
  //   measured_by_waymo: whether the horizon reaches a time at which Waymo's benchmark measures.
  explicit ReportSums(bool measured_by_waymo) : measured_by_waymo_(measured_by_waymo) {}

  void Add(const Measurement& measured);
  int64_t examples() const { return set_.examples(); }

  // Needs at least one measurement.
  v1::EvaluationReport MakeReport() const;

 private:
  // Sums over the examples of a stratum.
  struct Part {
    Part(size_t metrics, int actions) : sums(metrics), statistics(actions) {}
    void Add(std::span<const double> values, const Measurement& measured);

    std::vector<double> sums;  // of metrics_
    ActionStatistics statistics;
    int64_t examples = 0;
  };

  void Begin(const Measurement& first);
  void AddStrata(v1::EvaluationReport& report) const;

  bool measured_by_waymo_;
  std::vector<ExampleMetric> metrics_;
  std::vector<double> values_;  // of metrics_ for the latest example
  std::vector<double> sums_;    // of metrics_
  SetSums set_;
  std::vector<std::vector<Part>> strata_;  // as Stratifications() has them
  InputRanges input_ranges_;
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_REPORT_H_
