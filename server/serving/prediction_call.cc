#include "server/serving/prediction_call.h"

#include <algorithm>
#include <numeric>

#include "maneuver/v1/scenario.pb.h"

namespace maneuver::serving {

std::vector<int> SelectActions(const Eigen::VectorXd& probabilities,
                               const ActionSelection& selection) {
  std::vector<int> actions;
  if (const auto* chosen = std::get_if<ActionIds>(&selection)) {
    actions = chosen->ids;
  } else {
    actions.resize(static_cast<size_t>(probabilities.size()));
    std::iota(actions.begin(), actions.end(), 0);
  }
  std::ranges::sort(actions, [&](int a, int b) {
    return probabilities[a] != probabilities[b] ? probabilities[a] > probabilities[b] : a < b;
  });
  if (const auto* top = std::get_if<TopK>(&selection)) {
    actions.resize(std::min(actions.size(), static_cast<size_t>(top->k)));
  } else if (const auto* least = std::get_if<AtLeast>(&selection)) {
    std::erase_if(actions, [&](int a) { return probabilities[a] < least->probability; });
  }
  return actions;
}

void Draw(const Target& target, scene::Rasterizer& rasterizer, scene::Raster* raster) {
  const v1::Scenario& scenario = *target.scenario;
  const double now = scenario.prediction_time();
  if (target.map != nullptr) {
    rasterizer.Rasterize(scenario, *target.map, now, target.id, target.X_WT, {}, raster);
  } else {
    const auto map = scene::RoadMap::Over(scenario.map_features());
    rasterizer.Rasterize(scenario, map, now, target.id, target.X_WT, {}, raster);
  }
}

absl::Status PredictionCall::Alive(TimePoint now) const {
  if (cancelled.load(std::memory_order_relaxed)) {
    return absl::CancelledError("the caller cancelled the request");
  }
  if (now >= deadline) {
    return absl::DeadlineExceededError(
        "the deadline passed before the answer was ready; allow more time or ask for less at once");
  }
  return absl::OkStatus();
}

}  // namespace maneuver::serving
