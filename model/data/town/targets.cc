#include "model/data/town/targets.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

namespace maneuver::data::town {
namespace {

constexpr double kHistory = 1.0;  // seconds
constexpr double kFuture = 8.0;
constexpr size_t kMostTargets = 4;
constexpr double kLeastWay = 3.0;  // metres within four seconds

struct Candidate {
  int64_t id = 0;
  double interest = 0.0;
};

double InterestOf(const std::string& maneuver) {
  if (maneuver == "keep_lane") return 0.5;
  if (maneuver == "standing") return 0.0;
  if (maneuver == "stop" || maneuver == "start") return 1.0;
  if (maneuver.starts_with("follow_curve")) return 1.0;
  return 2.0;
}

const v1::AgentState* StateAt(const v1::Agent& agent, double time) {
  for (const v1::AgentState& state : agent.states()) {
    if (std::abs(state.time() - time) < 1e-6) return &state;
  }
  return nullptr;
}

}  // namespace

void ChooseTargets(const TownOptions& options, TownRecording& recording) {
  v1::Scenario& scenario = recording.scenario;
  std::multimap<int64_t, const v1::ManeuverAnnotation*> by_agent;
  for (const v1::ManeuverAnnotation& annotation : recording.maneuvers) {
    by_agent.emplace(annotation.agent_id(), &annotation);
  }
  const auto candidates_at = [&](double time) {
    std::vector<Candidate> candidates;
    const double horizon = std::min(kFuture, options.duration - time);
    for (const v1::Agent& agent : scenario.agents()) {
      if (agent.type() != v1::AGENT_TYPE_VEHICLE) continue;
      const v1::AgentState* now = StateAt(agent, time);
      if (now == nullptr || agent.states(0).time() > time - kHistory + 1e-6) continue;
      const double soon = std::min(time + 4.0, options.duration);
      const v1::AgentState* later = nullptr;
      for (const v1::AgentState& state : agent.states()) {
        if (state.time() <= soon + 1e-6) later = &state;
      }
      if (std::hypot(later->x() - now->x(), later->y() - now->y()) < kLeastWay) continue;
      Candidate candidate{.id = agent.id()};
      const auto [first, last] = by_agent.equal_range(agent.id());
      for (auto it = first; it != last; ++it) {
        const double overlap =
            std::min(it->second->end_time(), time + 5.0) - std::max(it->second->start_time(), time);
        if (overlap > 0.0) candidate.interest += overlap * InterestOf(it->second->maneuver());
      }
      // Prefers vehicles whose whole future is known.
      const double known = agent.states(agent.states_size() - 1).time() - time;
      if (known < horizon - 1e-6) candidate.interest *= 0.4 * known / horizon;
      candidates.push_back(candidate);
    }
    std::stable_sort(
        candidates.begin(), candidates.end(),
        [](const Candidate& a, const Candidate& b) { return a.interest > b.interest; });
    if (candidates.size() > kMostTargets) candidates.resize(kMostTargets);
    return candidates;
  };
  const double earliest = std::min(kHistory, options.duration);
  const double latest = std::max(earliest, options.duration - kFuture);
  const int first = static_cast<int>(std::ceil(earliest / options.frame_interval - 1e-9));
  const int last = static_cast<int>(std::floor(latest / options.frame_interval + 1e-9));
  const int stride = std::max(1, static_cast<int>(0.5 / options.frame_interval));
  double best = -1.0;
  std::vector<Candidate> chosen;
  for (int frame = first; frame <= last || frame == first; frame += stride) {
    const double time = frame * options.frame_interval;
    std::vector<Candidate> candidates = candidates_at(time);
    double interest = 0.0;
    for (const Candidate& candidate : candidates) interest += candidate.interest;
    if (interest <= best) continue;
    best = interest;
    scenario.set_prediction_time(time);
    chosen = std::move(candidates);
  }
  for (const Candidate& candidate : chosen) scenario.add_target_ids(candidate.id);
}

}  // namespace maneuver::data::town
