// Draws a model's actions at several speeds.

#ifndef MANEUVER_CLIENT_CLI_ACTION_GALLERY_H_
#define MANEUVER_CLIENT_CLI_ACTION_GALLERY_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/cli/environment.h"
#include "client/plot/action_gallery_plot.h"
#include "maneuver/v1/model_service.pb.h"

namespace maneuver::cli {

// Returns the actions of a version at 0, 5, 10 and 20 m/s; one set alone if they are the same at
// every speed (v1::ActionSet.speed is not set).
absl::StatusOr<std::vector<v1::ActionSet>> ActionSetsOf(const std::string& model_version,
                                                        Environment& environment);

// Asks the server for the actions of a version at 0, 5, 10 and 20 m/s, and draws them. Returns a
// PNG file. For models whose actions differ by speed (v1::ActionSet.speed is set).
absl::StatusOr<std::string> DrawGallery(const std::string& model_version,
                                        const plot::ActionGalleryOptions& options,
                                        Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_ACTION_GALLERY_H_
