#include "model/data/nuscenes/nuscenes_scene.h"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "model/data/recording_split.h"
#include "model/data/stable_hash.h"
#include "model/scene/pose2.h"

namespace maneuver::data {
namespace {

using scene::Point2;

// Renault Zoe, metres. The rear overhang is the length less wheelbase (2.588) and front overhang
// (0.839).
constexpr double kEgoLength = 4.084;
constexpr double kEgoWidth = 1.730;
constexpr double kRearOverhang = 0.657;
constexpr double kCenterAhead = kEgoLength / 2.0 - kRearOverhang;

constexpr double kLeastEgoStep = 0.075;  // seconds
constexpr double kHistory = 2.0;         // seconds before the prediction time

v1::AgentType TypeOf(const NuScenesTrack& track) {
  const std::string_view category = track.category;
  if (category == "vehicle.bicycle") {
    return track.unridden && !track.ridden ? v1::AGENT_TYPE_OTHER : v1::AGENT_TYPE_CYCLIST;
  }
  if (category.starts_with("vehicle.")) return v1::AGENT_TYPE_VEHICLE;
  if (category.starts_with("human.pedestrian.stroller") ||
      category.starts_with("human.pedestrian.personal_mobility")) {
    return v1::AGENT_TYPE_OTHER;
  }
  return category.starts_with("human.") ? v1::AGENT_TYPE_PEDESTRIAN : v1::AGENT_TYPE_OTHER;
}

std::vector<Keyframe> Sorted(std::vector<Keyframe> keyframes) {
  std::sort(keyframes.begin(), keyframes.end(),
            [](const Keyframe& a, const Keyframe& b) { return a.time < b.time; });
  return keyframes;
}

v1::Agent EgoOf(const NuScenesScene& scene) {
  v1::Agent ego;
  ego.set_type(v1::AGENT_TYPE_VEHICLE);
  ego.set_length(kEgoLength);
  ego.set_width(kEgoWidth);
  std::vector<Keyframe> kept;
  for (Keyframe pose : Sorted(scene.ego)) {
    if (!kept.empty() && pose.time - kept.back().time < kLeastEgoStep) continue;
    pose.x += kCenterAhead * std::cos(pose.heading);
    pose.y += kCenterAhead * std::sin(pose.heading);
    kept.push_back(pose);
  }
  AddFrames(kept, &ego);
  return ego;
}

// Leaves out frames before the scene's first sample and after its last.
void KeepWithin(double duration, v1::Agent* agent) {
  auto* const states = agent->mutable_states();
  states->erase(std::remove_if(states->begin(), states->end(),
                               [duration](const v1::AgentState& state) {
                                 return state.time() < 0.0 || state.time() > duration;
                               }),
                states->end());
}

}  // namespace

absl::StatusOr<v1::Scenario> ScenarioOf(const NuScenesScene& scene, const CityMap* map) {
  if (!scene.damage.empty()) return absl::InvalidArgumentError(scene.damage);
  v1::Scenario scenario;
  scenario.set_scenario_id(PartId(scene.log, scene.name));
  v1::Agent ego = EgoOf(scene);
  KeepWithin(scene.duration, &ego);
  if (ego.states().empty()) {
    return absl::InvalidArgumentError("the recording car has no two poses next to each other");
  }
  std::vector<Point2> path;
  for (const v1::AgentState& state : ego.states()) path.push_back({state.x(), state.y()});
  scenario.set_prediction_time(std::min(kHistory, ego.states().rbegin()->time()));
  *scenario.add_agents() = std::move(ego);
  for (const NuScenesTrack& track : scene.tracks) {
    const std::vector<Keyframe> keyframes = Sorted(track.keyframes);
    for (size_t i = 1; i < keyframes.size(); ++i) {
      if (keyframes[i].time > keyframes[i - 1].time) continue;
      return absl::InvalidArgumentError(
          absl::StrCat("instance ", track.token, " has two annotations in one sample"));
    }
    v1::Agent agent;
    agent.set_id(AgentId(track.token));
    agent.set_type(TypeOf(track));
    agent.set_length(track.length);
    agent.set_width(track.width);
    AddFrames(keyframes, &agent);
    if (!agent.states().empty()) *scenario.add_agents() = std::move(agent);
  }
  if (map != nullptr) map->AddNear(path, &scenario);
  return scenario;
}

}  // namespace maneuver::data
