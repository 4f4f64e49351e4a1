#include "server/serving/joint_answer.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "maneuver/v1/scenario.pb.h"
#include "model/scene/target_frame.h"
#include "server/serving/answer_check.h"

namespace maneuver::serving {
namespace {

inference::JointCombinations Combine(const DescribeActions& question,
                                     std::span<const Target> targets,
                                     const std::vector<size_t>& combined, double waypoint_interval,
                                     std::span<TargetAnswer> answers) {
  std::vector<inference::JointTarget> joint;
  for (const size_t i : combined) {
    const Target& target = targets[i];
    const v1::Agent* agent = scene::FindAgent(*target.scenario, target.id);
    joint.push_back(answers[i].joint);
    joint.back().id = target.id;
    joint.back().length = agent->length();
    joint.back().width = agent->width();
    joint.back().X_WT = target.X_WT;
  }
  return inference::CombineActions(joint, waypoint_interval, question.combinations);
}

// Describes the actions that `combinations` name for target `n` of theirs.
void DescribeNamed(const std::vector<inference::JointCombination>& combinations, size_t n,
                   inference::LatentSource source, inference::InferenceSession& session,
                   TargetAnswer* answer) {
  std::vector<inference::ActionDistribution>& described = answer->distributions;
  std::vector<int> missing;
  for (const inference::JointCombination& each : combinations) {
    const int action = each.actions[n];
    if (std::ranges::find(missing, action) != missing.end()) continue;
    if (std::ranges::find(described, action, &inference::ActionDistribution::action) ==
        described.end()) {
      missing.push_back(action);
    }
  }
  if (missing.empty()) return;
  auto more = session.Describe(answer->encoding, missing, source);
  std::ranges::move(more, std::back_inserter(described));
  const Eigen::VectorXd& probabilities = answer->encoding.probabilities;
  std::ranges::sort(described, [&](const auto& a, const auto& b) {
    const double difference = probabilities[a.action] - probabilities[b.action];
    return difference != 0.0 ? difference > 0.0 : a.action < b.action;
  });
  answer->status = CheckAnswer(*answer);
}

}  // namespace

std::vector<TargetRange> ScenariosOf(std::span<const Target> targets) {
  std::vector<TargetRange> ranges;
  for (size_t i = 0; i < targets.size(); ++i) {
    if (i == 0 || targets[i].scenario != targets[i - 1].scenario) ranges.push_back({i, i});
    ranges.back().end = i + 1;
  }
  return ranges;
}

JointAnswer CombineTargets(const DescribeActions& question, std::span<const Target> targets,
                           const TargetRange& range, double waypoint_interval,
                           inference::InferenceSession& session, std::span<TargetAnswer> answers) {
  JointAnswer joint;
  for (size_t i = range.begin; i < range.end; ++i) {
    if (answers[i].status.ok()) joint.targets.push_back(i);
  }
  while (!joint.targets.empty()) {
    joint.found = Combine(question, targets, joint.targets, waypoint_interval, answers);
    for (size_t n = 0; n < joint.targets.size(); ++n) {
      DescribeNamed(joint.found.combinations, n, question.source, session,
                    &answers[joint.targets[n]]);
    }
    if (std::erase_if(joint.targets, [&](size_t i) { return !answers[i].status.ok(); }) == 0) break;
    joint.found = {};
  }
  return joint;
}

}  // namespace maneuver::serving
