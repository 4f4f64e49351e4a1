// A model beside its rivals on the same examples, and whether the difference is more than chance.

#ifndef MANEUVER_MODEL_EVALUATION_RIVAL_COMPARISON_H_
#define MANEUVER_MODEL_EVALUATION_RIVAL_COMPARISON_H_

#include <functional>
#include <optional>
#include <string_view>
#include <vector>

#include "maneuver/v1/rivals.pb.h"
#include "model/data/recording_groups.h"
#include "model/evaluation/evaluator.h"
#include "model/evaluation/grouped_sums.h"

namespace maneuver::evaluation {

// Returns the comparison of each of kComparedMetrics with each of kRivals, where both have a
// column. The difference is that of two means over the same examples.
//   column: of a metric in the sums; empty if there is none
std::vector<v1::RivalComparison> CompareWithRivals(
    const Estimator& estimator, const std::function<std::optional<int>(std::string_view)>& column);

// Returns how the model stands over all examples, and by speed and by kinematic class. Parts
// without examples are left out. The bootstrap draws the groups of all recordings of the
// evaluation, as in cross-validation.
//   measured: at least one example
//   groups: of the recordings of the evaluation, in their order
v1::RivalStandings MakeRivalStandings(const MeasuredExamples& measured,
                                      const data::RecordingGroups& groups,
                                      const BootstrapOptions& options = {});

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_RIVAL_COMPARISON_H_
