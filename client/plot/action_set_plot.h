// Draws the actions that a model has learned.

#ifndef MANEUVER_CLIENT_PLOT_ACTION_SET_PLOT_H_
#define MANEUVER_CLIENT_PLOT_ACTION_SET_PLOT_H_

#include <string>

#include "absl/status/statusor.h"
#include "maneuver/v1/model_service.pb.h"

namespace maneuver::plot {

struct ActionSetPlotOptions {
  // Pixels; 0: chosen by the number of actions.
  int width = 0;
  int height = 0;
  // Also draws actions that are not effective.
  bool all = false;
};

// Draws one panel for each effective action, or for all if none is effective: its mean in black,
// its sigma trajectories coloured by latent dimension, axes in metres at the same scale. Above it
// are id, name and usage. Returns a PNG file; the same input gives the same file. INVALID_ARGUMENT
// if there are no actions, a trajectory has unequal numbers of x and y, or the size is out of
// range.
absl::StatusOr<std::string> DrawActionSet(const v1::ActionSet& actions,
                                          const ActionSetPlotOptions& options);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_ACTION_SET_PLOT_H_
