#include "model/evaluation/rival_table.h"

#include <algorithm>

namespace maneuver::evaluation {

const Rival* FindRival(std::string_view name) {
  const auto* const found = std::ranges::find(kRivals, name, &Rival::name);
  return found == kRivals.end() ? nullptr : found;
}

std::string RivalMetric(const Rival& rival, std::string_view metric) {
  if (std::ranges::find(kComparedMetrics, metric) == kComparedMetrics.end()) return "";
  if (rival.trained) {
    // Baselines have no medoid.
    if (metric.ends_with("_medoid")) return "";
    return std::string(rival.name) + "_" + std::string(metric);
  }
  // A predictor of one trajectory is compared with the most probable one or with the medoid.
  for (const std::string_view single : {"_1", "_medoid"}) {
    if (!metric.ends_with(single)) continue;
    metric.remove_suffix(single.size());
    return std::string(metric) + "_" + std::string(rival.name);
  }
  return "";
}

}  // namespace maneuver::evaluation
