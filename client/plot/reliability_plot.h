// Draws how reliable the probabilities of a model are.

#ifndef MANEUVER_CLIENT_PLOT_RELIABILITY_PLOT_H_
#define MANEUVER_CLIENT_PLOT_RELIABILITY_PLOT_H_

#include <string>

#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::plot {

// Draws the report's reliability table. Over each bin's mean p(y|s) of the most probable action
// stands the mean q(y|x,s) of that action. Its distance from the diagonal, averaged, is the
// expected calibration error in the title. Below are the numbers of examples in each bin. Returns a
// PNG file; the same input gives the same file. INVALID_ARGUMENT if no bin has an example.
absl::StatusOr<std::string> DrawReliability(const v1::EvaluationReport& report);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_RELIABILITY_PLOT_H_
