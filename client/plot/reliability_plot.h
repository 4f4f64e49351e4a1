// Draws how reliable the probabilities of a model are.

#ifndef MANEUVER_CLIENT_PLOT_RELIABILITY_PLOT_H_
#define MANEUVER_CLIENT_PLOT_RELIABILITY_PLOT_H_

#include <string>

#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::plot {

// Draws the report's reliability table: for each bin, the mean q(y|x,s) of the most probable action
// (vertical axis) over its mean p(y|s) (horizontal axis). The title gives the expected calibration
// error: the mean distance from the diagonal, weighted by examples. A second panel below shows the
// number of examples in each bin. Returns a PNG file; the same input gives the same file.
// INVALID_ARGUMENT if no bin has an example.
absl::StatusOr<std::string> DrawReliability(const v1::EvaluationReport& report);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_RELIABILITY_PLOT_H_
