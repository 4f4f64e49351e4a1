#include "client/cli/action_gallery.h"

#include <utility>

namespace maneuver::cli {
namespace {

constexpr double kGallerySpeeds[] = {0.0, 5.0, 10.0, 20.0};  // m/s

}  // namespace

absl::StatusOr<std::vector<v1::ActionSet>> ActionSetsOf(const std::string& model_version,
                                                        Environment& environment) {
  std::vector<v1::ActionSet> sets;
  for (const double speed : kGallerySpeeds) {
    v1::GetActionSetRequest request;
    request.set_name(model_version);
    request.set_speed(speed);
    auto set = environment.server_client().GetActionSet(request, environment.call_options());
    if (!set.ok()) return set.status();
    sets.push_back(*std::move(set));
    if (!sets.back().has_speed()) break;
  }
  return sets;
}

absl::StatusOr<std::string> DrawGallery(const std::string& model_version,
                                        const plot::ActionGalleryOptions& options,
                                        Environment& environment) {
  const auto sets = ActionSetsOf(model_version, environment);
  if (!sets.ok()) return sets.status();
  return plot::DrawActionGallery(*sets, options);
}

}  // namespace maneuver::cli
