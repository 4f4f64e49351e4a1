#include "model/evaluation/maneuver_labels.h"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <tuple>

#include "model/scene/target_frame.h"

namespace maneuver::evaluation {
namespace {

bool IsOfAMoment(const v1::ManeuverAnnotation& annotation) {
  return annotation.start_time() == annotation.end_time();
}

}  // namespace

ManeuverLabels::ManeuverLabels(std::span<const v1::ManeuverAnnotation> annotations) {
  const auto moment_of = [](const v1::ManeuverAnnotation& annotation) {
    return std::tuple(std::string_view(annotation.scenario_id()), annotation.agent_id(),
                      annotation.start_time());
  };
  std::map<std::tuple<std::string_view, int64_t, double>, const v1::ManeuverAnnotation*> latest;
  for (const v1::ManeuverAnnotation& annotation : annotations) {
    if (IsOfAMoment(annotation)) latest[moment_of(annotation)] = &annotation;
  }
  for (const v1::ManeuverAnnotation& annotation : annotations) {
    if (IsOfAMoment(annotation) && latest[moment_of(annotation)] != &annotation) continue;
    intervals_[{annotation.scenario_id(), annotation.agent_id()}].push_back(&annotation);
    const auto [_, is_new] =
        classes_.try_emplace(annotation.maneuver(), static_cast<int>(names_.size()));
    if (is_new) names_.push_back(annotation.maneuver());
  }
}

std::optional<int> ManeuverLabels::Over(const std::string& scenario_id, int64_t agent_id,
                                        double start, double end) const {
  const auto found = intervals_.find({scenario_id, agent_id});
  if (found == intervals_.end()) return std::nullopt;
  std::map<int, double> covered;  // seconds of the window, by class
  const v1::ManeuverAnnotation* moment = nullptr;
  double nearest = kNearMoment + scene::kSameTime;
  for (const v1::ManeuverAnnotation* annotation : found->second) {
    if (IsOfAMoment(*annotation)) {
      const double distance = std::abs(annotation->start_time() - start);
      if (distance < nearest) {
        nearest = distance;
        moment = annotation;
      }
      continue;
    }
    const double overlap =
        std::min(end, annotation->end_time()) - std::max(start, annotation->start_time());
    if (overlap > 0.0) covered[classes_.at(annotation->maneuver())] += overlap;
  }
  if (moment != nullptr) return classes_.at(moment->maneuver());
  if (covered.empty()) return std::nullopt;
  return std::max_element(covered.begin(), covered.end(),
                          [](const auto& a, const auto& b) { return a.second < b.second; })
      ->first;
}

}  // namespace maneuver::evaluation
