#include "model/evaluation/input_ranges.h"

#include <algorithm>

namespace maneuver::evaluation {

const std::array<InputFigure, 3>& InputFigures() {
  static constexpr std::array<InputFigure, 3> kFigures = {
      {{"speed", [](const StratumKeys& keys) { return keys.speed; }},
       {"agents", [](const StratumKeys& keys) { return static_cast<double>(keys.agents); }},
       {"map", [](const StratumKeys& keys) { return static_cast<double>(keys.map_features); }}}};
  return kFigures;
}

int MapFeaturesNear(const scene::RoadMap& map, const scene::Pose2& X_WT) {
  constexpr double kReach = 50.0;  // metres
  const scene::Box near{X_WT.x() - kReach, X_WT.y() - kReach, X_WT.x() + kReach, X_WT.y() + kReach};
  return static_cast<int>(std::ranges::count_if(
      map.boxes(), [&](const scene::Box& box) { return box.Overlaps(near); }));
}

void Widen(const StratumKeys& keys, InputRanges& ranges) {
  for (const InputFigure& figure : InputFigures()) {
    const double value = figure.value(keys);
    const auto found = ranges.find(std::string(figure.name));
    v1::ValueRange& range =
        found == ranges.end() ? ranges[std::string(figure.name)] : found->second;
    range.set_low(found == ranges.end() ? value : std::min(range.low(), value));
    range.set_high(found == ranges.end() ? value : std::max(range.high(), value));
  }
}

bool IsOutside(const InputFigure& figure, const StratumKeys& keys, const InputRanges& ranges) {
  const auto range = ranges.find(std::string(figure.name));
  if (range == ranges.end()) return false;
  const double value = figure.value(keys);
  return value < range->second.low() || value > range->second.high();
}

}  // namespace maneuver::evaluation
