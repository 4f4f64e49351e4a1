#include "server/serving/prediction_call.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "maneuver/v1/scenario.pb.h"

namespace maneuver::serving {
namespace {

// Calls read(scenario, map) with the target's map.
template <typename Read>
void WithMap(const Target& target, Read&& read) {
  const v1::Scenario& scenario = *target.scenario;
  if (target.map != nullptr) return read(scenario, *target.map);
  read(scenario, scene::RoadMap::Over(scenario.map_features()));
}

// Sorts actions, the most probable first; of equally probable ones, the smaller id first.
void SortByProbability(const Eigen::VectorXd& probabilities, std::vector<int>* actions) {
  std::ranges::sort(*actions, [&](int a, int b) {
    return probabilities[a] != probabilities[b] ? probabilities[a] > probabilities[b] : a < b;
  });
}

}  // namespace

std::vector<int> SelectActions(const Eigen::VectorXd& probabilities,
                               const ActionSelection& selection) {
  std::vector<int> actions;
  if (const auto* chosen = std::get_if<ActionIds>(&selection)) {
    actions = chosen->ids;
  } else {
    actions.resize(static_cast<size_t>(probabilities.size()));
    std::iota(actions.begin(), actions.end(), 0);
  }
  // Sorting needs an order.
  std::erase_if(actions, [&](int a) { return std::isnan(probabilities[a]); });
  SortByProbability(probabilities, &actions);
  if (const auto* top = std::get_if<TopK>(&selection)) {
    actions.resize(std::min(actions.size(), static_cast<size_t>(top->k)));
  } else if (const auto* least = std::get_if<AtLeast>(&selection)) {
    std::erase_if(actions, [&](int a) { return probabilities[a] < least->probability; });
  }
  return actions;
}

void DescribeTarget(const DescribeActions& question, const inference::SceneEncoding& encoding,
                    double waypoint_interval, inference::InferenceSession& session,
                    TargetAnswer* answer) {
  const Eigen::VectorXd& probabilities = encoding.probabilities;
  std::vector<int> actions = SelectActions(probabilities, question.selection);
  answer->representatives.clear();
  if (question.representatives > 0) {
    const std::vector<int> candidates = inference::RepresentativeCandidates(probabilities);
    answer->representatives = inference::ChooseRepresentatives(
        probabilities, candidates, session.MeanTrajectories(encoding, candidates, question.source),
        waypoint_interval, question.representatives);
    for (const inference::Representative& each : answer->representatives) {
      if (std::ranges::find(actions, each.action) == actions.end()) actions.push_back(each.action);
    }
    SortByProbability(probabilities, &actions);
  }
  answer->distributions = session.Describe(encoding, actions, question.source);
  answer->joint = {};
  if (question.combinations > 0) {
    inference::JointTarget& joint = answer->joint;
    joint.actions = inference::JointActions(probabilities);
    for (const int action : joint.actions) {
      joint.log_probabilities.push_back(std::log(probabilities[action]));
    }
    joint.means = session.MeanTrajectories(encoding, joint.actions, question.source);
  }
}

void ReadRaster(const Target& target, scene::SceneReader& reader, scene::SceneInputs* inputs) {
  WithMap(target, [&](const v1::Scenario& scenario, const scene::RoadMap& map) {
    reader.ReadRaster(scenario, map, scenario.prediction_time(), target.id, target.X_WT, inputs);
  });
}

void ReadVectors(const Target& target, scene::SceneReader& reader, scene::SceneInputs* inputs) {
  WithMap(target, [&](const v1::Scenario& scenario, const scene::RoadMap& map) {
    reader.ReadVectors(scenario, map, scenario.prediction_time(), target.id, target.X_WT, inputs);
  });
}

void ReadScene(const Target& target, scene::SceneReader& reader, scene::SceneInputs* inputs) {
  WithMap(target, [&](const v1::Scenario& scenario, const scene::RoadMap& map) {
    reader.Read(scenario, map, scenario.prediction_time(), target.id, target.X_WT, inputs);
  });
}

absl::Status PredictionCall::CheckWanted(TimePoint now) const {
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
