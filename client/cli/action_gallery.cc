#include "client/cli/action_gallery.h"

#include <utility>
#include <vector>

#include "maneuver/v1/model_service.pb.h"

namespace maneuver::cli {
namespace {

constexpr double kGallerySpeeds[] = {0.0, 5.0, 10.0, 20.0};  // m/s

}  // namespace

absl::StatusOr<std::string> DrawGallery(const std::string& model_version,
                                        const plot::ActionGalleryOptions& options,
                                        Environment& environment) {
  std::vector<v1::ActionSet> sets;
  for (const double speed : kGallerySpeeds) {
    v1::GetActionSetRequest request;
    request.set_name(model_version);
    request.set_speed(speed);
    auto drawn = environment.server_client().GetActionSet(request, environment.call_options());
    if (!drawn.ok()) return drawn.status();
    sets.push_back(*std::move(drawn));
  }
  return plot::DrawActionGallery(sets, options);
}

}  // namespace maneuver::cli
