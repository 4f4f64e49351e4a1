#include "client/cli/target_selection.h"

#include <algorithm>
#include <cmath>

#include "model/scene/target_frame.h"

namespace maneuver::cli {
namespace {

constexpr double kHalfFrame = 0.05;   // seconds
constexpr double kHistory = 1.0;      // seconds, as the models look at
constexpr double kLeastTravel = 0.5;  // metres in that second; slower ones stand
constexpr int kMostTargets = 8;

}  // namespace

int CurrentState(const v1::Agent& agent, double time) {
  return scene::FindState(agent, time, kHalfFrame, time + scene::kSameTime);
}

std::vector<int64_t> MovingAgents(const v1::Scenario& scenario, v1::AgentType type, double time,
                                  int most) {
  std::vector<std::pair<double, int64_t>> travelled;
  for (const v1::Agent& agent : scenario.agents()) {
    if (agent.type() != type) continue;
    const int now = CurrentState(agent, time);
    const int before = CurrentState(agent, time - kHistory);
    if (now < 0 || before < 0) continue;
    const double distance = std::hypot(agent.states(now).x() - agent.states(before).x(),
                                       agent.states(now).y() - agent.states(before).y());
    if (distance >= kLeastTravel) travelled.emplace_back(-distance, agent.id());
  }
  std::sort(travelled.begin(), travelled.end());
  std::vector<int64_t> targets;
  for (const auto& [distance, id] : travelled) {
    if (static_cast<int>(targets.size()) < most) targets.push_back(id);
  }
  return targets;
}

std::vector<int64_t> DefaultTargets(const v1::Scenario& scenario, v1::AgentType type, double time) {
  std::vector<int64_t> targets;
  for (const int64_t id : scenario.target_ids()) {
    const v1::Agent* const agent = scene::FindAgent(scenario, id);
    if (agent == nullptr || agent->type() != type) continue;
    if (CurrentState(*agent, time) >= 0) targets.push_back(id);
  }
  return targets.empty() ? MovingAgents(scenario, type, time, kMostTargets) : targets;
}

}  // namespace maneuver::cli
