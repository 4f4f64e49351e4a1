// What the probabilities of a model are worth, as a picture.

#ifndef MANEUVER_CLIENT_PLOT_RELIABILITY_PLOT_H_
#define MANEUVER_CLIENT_PLOT_RELIABILITY_PLOT_H_

#include <string>

#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::plot {

// Draws the report's reliability table: over each bin's mean p(y|s) of the most probable action the
// mean q(y|x,s) of that action, with its distance from the diagonal, which is what the expected
// calibration error in the title is the mean of; below, how many examples each bin has.
// Returns a PNG file; the same for the same input. INVALID_ARGUMENT if no bin has an example.
absl::StatusOr<std::string> DrawReliability(const v1::EvaluationReport& report);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_RELIABILITY_PLOT_H_
