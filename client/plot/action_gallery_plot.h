// Draws the actions of a model that predicts relative to the present motion, at several speeds.

#ifndef MANEUVER_CLIENT_PLOT_ACTION_GALLERY_PLOT_H_
#define MANEUVER_CLIENT_PLOT_ACTION_GALLERY_PLOT_H_

#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "maneuver/v1/model_service.pb.h"

namespace maneuver::plot {

struct ActionGalleryOptions {
  int width = 1500;   // pixels
  int height = 1000;  // pixels
  // Also draws actions that are not effective. They are drawn anyway if no action is.
  bool all = false;
};

// Draws one panel for each set: the mean trajectories of its actions, each with the same colour in
// all panels and its id at the end. A dashed line shows where a target would be that keeps its
// speed. A legend has ids, names and usage of the most used actions, as many as fit. Axes in
// metres, with one scale per panel. Returns a PNG file; the same input gives the same file.
//   sets: action sets of one model version, each with its `speed`.
// INVALID_ARGUMENT if there is no set, a set has no speed or no actions, a trajectory has unequal
// numbers of x and y, or a side is not 200 to 12000 pixels.
absl::StatusOr<std::string> DrawActionGallery(std::span<const v1::ActionSet> sets,
                                              const ActionGalleryOptions& options);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_ACTION_GALLERY_PLOT_H_
