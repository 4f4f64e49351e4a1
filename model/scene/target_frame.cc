#include "model/scene/target_frame.h"

#include <algorithm>
#include <cmath>

namespace maneuver::scene {
namespace {

bool StartsAfter(double time, const v1::AgentState& state) { return time < state.time(); }

}  // namespace

const v1::Agent* FindAgent(const v1::Scenario& scenario, int64_t agent_id) {
  for (const v1::Agent& agent : scenario.agents()) {
    if (agent.id() == agent_id) return &agent;
  }
  return nullptr;
}

int FindState(const v1::Agent& agent, double time, double tolerance, double latest) {
  const auto& states = agent.states();
  const auto end = std::upper_bound(states.begin(), states.end(), latest, StartsAfter);
  const auto after = std::upper_bound(states.begin(), end, time, StartsAfter);
  int nearest = -1;
  double smallest = tolerance + kSameTime;
  const auto consider = [&](auto state) {
    const double distance = std::abs(state->time() - time);
    if (distance > smallest) return;
    smallest = distance;
    nearest = static_cast<int>(state - states.begin());
  };
  if (after != states.begin()) consider(after - 1);
  if (after != end) consider(after);
  return nearest;
}

const v1::TrafficSignalReading* LatestReading(const v1::TrafficSignal& signal, double time) {
  const auto& readings = signal.readings();
  const auto after = std::upper_bound(
      readings.begin(), readings.end(), time + kSameTime,
      [](double t, const v1::TrafficSignalReading& reading) { return t < reading.time(); });
  return after == readings.begin() ? nullptr : &*(after - 1);
}

std::optional<PresentState> PresentOf(const v1::Agent& agent, double time, double tolerance,
                                      int inputs_version) {
  const int index = FindState(agent, time, tolerance, time + kSameTime);
  if (index < 0) return std::nullopt;
  const v1::AgentState& state = agent.states(index);
  const double age = time - state.time();
  if (inputs_version < 3 || age <= kSameTime) return PresentState{&state, {state.x(), state.y()}};
  return PresentState{&state,
                      {state.x() + age * state.velocity_x(), state.y() + age * state.velocity_y()}};
}

std::optional<Pose2> TargetPose(const v1::Agent& agent, double time, double tolerance,
                                int inputs_version) {
  const auto present = PresentOf(agent, time, tolerance, inputs_version);
  if (!present) return std::nullopt;
  return Pose2(present->position.x, present->position.y, present->state->heading());
}

}  // namespace maneuver::scene
