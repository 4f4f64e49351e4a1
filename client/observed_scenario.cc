#include "client/observed_scenario.h"

#include <algorithm>

namespace maneuver::client {
namespace {

constexpr double kRounding = 1e-6;  // seconds

// Removes the elements later than `now`, wherever they are.
template <typename Timed>
void RemoveLater(double now, google::protobuf::RepeatedPtrField<Timed>* elements) {
  const auto first_removed =
      std::stable_partition(elements->begin(), elements->end(),
                            [now](const Timed& element) { return !(element.time() > now); });
  elements->erase(first_removed, elements->end());
}

}  // namespace

void StripFuture(v1::Scenario* scenario) {
  const double now = scenario->prediction_time() + kRounding;
  const auto& targets = scenario->target_ids();
  auto* agents = scenario->mutable_agents();
  for (v1::Agent& agent : *agents) RemoveLater(now, agent.mutable_states());
  agents->erase(std::remove_if(agents->begin(), agents->end(),
                               [&](const v1::Agent& agent) {
                                 return agent.states().empty() &&
                                        std::find(targets.begin(), targets.end(), agent.id()) ==
                                            targets.end();
                               }),
                agents->end());
  for (v1::TrafficSignal& signal : *scenario->mutable_traffic_signals()) {
    RemoveLater(now, signal.mutable_readings());
  }
}

}  // namespace maneuver::client
