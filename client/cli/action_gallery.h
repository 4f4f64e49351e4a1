// Draws a model's actions at several speeds.

#ifndef MANEUVER_CLIENT_CLI_ACTION_GALLERY_H_
#define MANEUVER_CLIENT_CLI_ACTION_GALLERY_H_

#include <string>

#include "absl/status/statusor.h"
#include "client/cli/environment.h"
#include "client/plot/action_gallery_plot.h"

namespace maneuver::cli {

// Asks the server for the actions of a version at 0, 5, 10 and 20 m/s, and draws them. Returns a
// PNG file. For models whose actions differ by speed (v1::ActionSet.speed is set).
absl::StatusOr<std::string> DrawGallery(const std::string& model_version,
                                        const plot::ActionGalleryOptions& options,
                                        Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_ACTION_GALLERY_H_
