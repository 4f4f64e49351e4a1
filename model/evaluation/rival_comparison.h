// Compares a model with its rivals on the same examples, and tests whether differences exceed
// chance.

#ifndef MANEUVER_MODEL_EVALUATION_RIVAL_COMPARISON_H_
#define MANEUVER_MODEL_EVALUATION_RIVAL_COMPARISON_H_

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "maneuver/v1/rivals.pb.h"
#include "model/data/recording_groups.h"
#include "model/evaluation/example_metrics.h"
#include "model/evaluation/grouped_sums.h"
#include "model/evaluation/measured_examples.h"
#include "model/evaluation/strata.h"

namespace maneuver::evaluation {

// Compares the model with each of kRivals by each of kComparedMetrics, if both have a column. The
// difference is that of two means over the same examples. The verdict is undecided if its interval
// contains 0, or with fewer than kLeastDecidingGroups groups.
//   column: returns the column of a metric in the sums, or nothing.
std::vector<v1::RivalComparison> CompareWithRivals(
    const Estimator& estimator, const std::function<std::optional<int>(std::string_view)>& column);

// Sums over measurements, from which a model's standing among its rivals is made. Their memory
// grows with the number of groups, up to kMostDrawnGroups.
class RivalSums {
 public:
  //   groups: the groups of the evaluation's recordings
  RivalSums(data::RecordingGroups groups, bool measured_by_waymo)
      : groups_(std::move(groups)), measured_by_waymo_(measured_by_waymo) {}

  //   recording: index of the example's recording in `groups`
  void Add(size_t recording, const Measurement& measured);

  // Returns the standing over all examples, by speed, and by kinematic class. Leaves out parts
  // without examples, and the comparisons of parts with fewer than kLeastComparedExamples. The
  // bootstrap draws groups from all recordings of the evaluation, as in cross-validation. Needs at
  // least one measurement.
  v1::RivalStandings MakeStandings(const BootstrapOptions& options = {}) const;

 private:
  // One part of the examples.
  struct Part {
    std::string_view dimension;
    std::string_view name;
    GroupedSums sums;
    int64_t examples = 0;
  };
  // One way to divide the examples, with the sums of its parts.
  struct Division {
    const Stratification* stratification;
    std::vector<Part> parts;
  };

  void Begin(const Measurement& first);
  std::optional<int> Column(std::string_view metric) const;

  data::RecordingGroups groups_;
  bool measured_by_waymo_;
  std::vector<ExampleMetric> metrics_;  // column i + 1 is metric i
  Eigen::VectorXd row_;                 // of the latest example; row_[0] is 1
  std::vector<Part> all_;               // one part, once there is an example
  std::vector<Division> divisions_;
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_RIVAL_COMPARISON_H_
