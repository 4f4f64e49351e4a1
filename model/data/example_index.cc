#include "model/data/example_index.h"

#include <algorithm>
#include <cmath>

#include "model/data/stable_hash.h"
#include "model/data/trajectory.h"
#include "model/scene/duration.h"
#include "model/scene/motion_reference.h"
#include "model/scene/observation_window.h"
#include "model/scene/scenario_validation.h"
#include "model/scene/target_frame.h"
#include "model/scene/target_history.h"

namespace maneuver::data {
namespace {

// What all examples of a spec share.
struct Window {
  double stride;
  double past;       // from the oldest frame to the present
  double tolerance;  // half a frame interval
  double max_gap;    // between two states
  std::vector<double> waypoint_times;
  double max_speed;  // of any target; infinity: no limit
  double standing_distance;
  double keep_standing;
  v1::TrajectoryReference reference;
  int inputs_version;
};

Window MakeWindow(const v1::ModelSpec& spec, const v1::ExampleSettings& settings) {
  const scene::ObservationWindow observed = scene::WindowOf(spec);
  Window window;
  window.stride = scene::ToSeconds(settings.stride());
  window.past = observed.past;
  window.tolerance = observed.tolerance();
  window.max_gap = observed.max_gap();
  window.reference = spec.reference();
  window.inputs_version = spec.inputs_version();
  const double waypoint_interval = scene::ToSeconds(spec.trajectory().waypoint_interval());
  for (int i = 1; i <= spec.trajectory().waypoints(); ++i) {
    window.waypoint_times.push_back(i * waypoint_interval);
  }
  window.max_speed = settings.max_speed() > 0 ? settings.max_speed() : HUGE_VAL;
  window.standing_distance = settings.standing_distance();
  window.keep_standing = settings.keep_standing();
  return window;
}

bool LearnsFrom(const v1::ModelSpec& spec, v1::AgentType type) {
  const auto& types = spec.target_types();
  if (types.empty()) return type == v1::AGENT_TYPE_VEHICLE;
  return std::find(types.begin(), types.end(), type) != types.end();
}

bool Parks(v1::AgentType type) {
  return type != v1::AGENT_TYPE_PEDESTRIAN && type != v1::AGENT_TYPE_CYCLIST;
}

double Distance(const v1::AgentState& a, const v1::AgentState& b) {
  return std::hypot(b.x() - a.x(), b.y() - a.y());
}

// Returns the indices of the states that examples start from.
std::vector<int> StartStates(const v1::Agent& agent, const Window& window) {
  std::vector<int> starts;
  if (agent.states().empty() || !(window.stride > 0.0)) return starts;
  const double first = agent.states().begin()->time();
  const double last = agent.states().rbegin()->time();
  const double end = std::floor((last + window.tolerance) / window.stride);
  for (double k = std::ceil((first - window.tolerance) / window.stride); k <= end; ++k) {
    const int start = scene::FindState(agent, k * window.stride, window.tolerance, HUGE_VAL);
    if (start < 0) {
      // Continues just before the next state: a gap may be millions of strides long.
      const auto next =
          std::ranges::upper_bound(agent.states(), k * window.stride, {}, &v1::AgentState::time);
      if (next == agent.states().end()) break;
      k = std::max(k, std::floor((next->time() - window.tolerance) / window.stride) - 2.0);
      continue;
    }
    // A stride shorter than the track's own interval reaches the same state twice.
    if (starts.empty() || start > starts.back()) starts.push_back(start);
  }
  return starts;
}

// Returns whether the track from state `first` to `end_time`, or to its end, is one motion: no gap
// up to state `now` and no step that is too fast. ResampleFuture checks for later gaps.
bool IsContinuous(const v1::Agent& agent, int first, int now, double end_time,
                  const Window& window) {
  const double max_speed = std::min(window.max_speed, MostSpeed(agent.type()));
  for (int i = first + 1; i < agent.states_size(); ++i) {
    const v1::AgentState& before = agent.states(i - 1);
    if (before.time() >= end_time) break;
    const v1::AgentState& after = agent.states(i);
    const double step = after.time() - before.time();
    if (i <= now && step > window.max_gap) return false;
    if (Distance(before, after) > max_speed * step) return false;
  }
  return true;
}

bool Stands(std::span<const double> trajectory, double standing_distance) {
  for (size_t i = 0; i + 1 < trajectory.size(); i += 2) {
    if (std::hypot(trajectory[i], trajectory[i + 1]) >= standing_distance) return false;
  }
  return true;
}

bool KeepsStanding(uint64_t scenario_hash, int64_t target_id, double time, double keep_standing) {
  const auto milliseconds = static_cast<int64_t>(std::llround(time * 1000.0));
  const uint64_t hash = MixHash(MixHash(scenario_hash, static_cast<uint64_t>(target_id)),
                                static_cast<uint64_t>(milliseconds));
  return UnitInterval(hash) < keep_standing;
}

// Returns whether all states are physically possible. Recordings that were stored before validation
// had these bounds may hold others.
bool IsPossible(const v1::Agent& agent) {
  return std::ranges::all_of(agent.states(), [](const v1::AgentState& state) {
    return scene::IsPhysicallyPossible(state);
  });
}

// Returns r(m) at the waypoints, [T, 2] target frame, metres; empty without a reference.
std::vector<float> ReferenceOf(const v1::Agent& agent, double time, const scene::Pose2& X_WT,
                               const Window& window) {
  if (window.reference == v1::TRAJECTORY_REFERENCE_UNSPECIFIED ||
      window.reference == v1::TRAJECTORY_REFERENCE_NONE) {
    return {};
  }
  std::vector<double> reference(2 * window.waypoint_times.size());
  scene::RollOut(window.reference, window.inputs_version,
                 scene::EstimateMotion(scene::ResampleHistory(agent, time, X_WT)),
                 window.waypoint_times, reference);
  return {reference.begin(), reference.end()};
}

}  // namespace

std::vector<Example> EnumerateExamples(const v1::Scenario& recording, int recording_index,
                                       const v1::ModelSpec& spec,
                                       const v1::ExampleSettings& settings,
                                       int64_t* standing_seen) {
  const Window window = MakeWindow(spec, settings);
  std::vector<Example> examples;
  if (window.waypoint_times.empty()) return examples;
  const uint64_t scenario_hash = StableHash(recording.scenario_id());
  std::vector<double> trajectory(2 * window.waypoint_times.size());
  for (const v1::Agent& agent : recording.agents()) {
    if (!LearnsFrom(spec, agent.type()) || !IsPossible(agent)) continue;
    const double keep_standing = Parks(agent.type()) ? window.keep_standing : 1.0;
    for (const int now : StartStates(agent, window)) {
      const v1::AgentState& state = agent.states(now);
      const int oldest =
          scene::FindState(agent, state.time() - window.past, window.tolerance, state.time());
      if (oldest < 0) continue;
      const double end_time = state.time() + window.waypoint_times.back();
      if (!IsContinuous(agent, oldest, now, end_time, window)) continue;
      const scene::Pose2 X_WT(state.x(), state.y(), state.heading());
      if (!ResampleFuture(agent, state.time(), X_WT, window.waypoint_times, window.max_gap,
                          trajectory)) {
        continue;
      }
      const bool standing = Stands(trajectory, window.standing_distance);
      if (standing) {
        if (standing_seen != nullptr) ++*standing_seen;
        if (!KeepsStanding(scenario_hash, agent.id(), state.time(), keep_standing)) continue;
      }
      examples.push_back({.recording = recording_index,
                          .target_id = agent.id(),
                          .time = state.time(),
                          .X_WT = X_WT,
                          .trajectory = {trajectory.begin(), trajectory.end()},
                          .standing = standing,
                          .motion = scene::DescribeMotion(agent, state.time()),
                          .reference = ReferenceOf(agent, state.time(), X_WT, window)});
    }
  }
  return examples;
}

double MostSpeed(v1::AgentType type) {
  switch (type) {
    case v1::AGENT_TYPE_PEDESTRIAN:
      return 10.0;
    case v1::AGENT_TYPE_CYCLIST:
      return 25.0;
    default:
      return HUGE_VAL;
  }
}

}  // namespace maneuver::data
