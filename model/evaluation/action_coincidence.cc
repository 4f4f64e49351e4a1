#include "model/evaluation/action_coincidence.h"

#include <map>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "model/evaluation/action_matching.h"
#include "model/evaluation/calibration.h"
#include "model/evaluation/clustering.h"

namespace maneuver::evaluation {
namespace {

Eigen::VectorXd SharesOf(std::span<const Measurement> measured) {
  ActionStatistics statistics(static_cast<int>(measured.front().probabilities.size()));
  for (const Measurement& each : measured)
    statistics.Add(each.probabilities, each.responsibilities);
  return statistics.MeanProbability();
}

}  // namespace

absl::StatusOr<v1::ActionMatching> MatchActions(const inference::ActionModel& first,
                                                const inference::ActionModel& second,
                                                const EvaluationInput& input) {
  const absl::StatusOr<MeasuredExamples> ours = MeasureExamples(first, input);
  if (!ours.ok()) return ours.status();
  const absl::StatusOr<MeasuredExamples> theirs = MeasureExamples(second, input);
  if (!theirs.ok()) return theirs.status();
  absl::StatusOr<v1::ActionMatching> matching = MatchActions(
      first.manifest(), SharesOf(ours->measured), second.manifest(), SharesOf(theirs->measured));
  if (!matching.ok()) return matching;

  // Models that look back differently far do not have the same examples.
  const auto key = [](const data::Example& example) {
    return std::tuple(example.recording, example.target_id, example.time);
  };
  std::map<std::tuple<int, int64_t, double>, int> action_of;
  for (size_t i = 0; i < ours->examples.size(); ++i) {
    action_of[key(ours->examples[i])] = ours->measured[i].action;
  }
  std::vector<int> first_actions;
  std::vector<int> second_actions;
  for (size_t i = 0; i < theirs->examples.size(); ++i) {
    const auto found = action_of.find(key(theirs->examples[i]));
    if (found == action_of.end()) continue;
    first_actions.push_back(found->second);
    second_actions.push_back(theirs->measured[i].action);
  }
  *matching->mutable_coincidence() = CoincidenceOf(first_actions, second_actions, *matching);
  return matching;
}

v1::ActionCoincidence CoincidenceOf(std::span<const int> first, std::span<const int> second,
                                    const v1::ActionMatching& matching) {
  std::set<std::pair<int, int>> pairs;
  for (const v1::ActionPair& pair : matching.pairs()) {
    pairs.emplace(pair.first().action_id(), pair.second().action_id());
  }
  ContingencyTable table;
  int64_t paired = 0;
  for (size_t i = 0; i < first.size(); ++i) {
    table.Add(first[i], second[i]);
    if (pairs.contains({first[i], second[i]})) ++paired;
  }
  v1::ActionCoincidence coincidence;
  coincidence.set_examples(table.total());
  coincidence.set_normalized_mutual_information(table.NormalizedMutualInformation());
  if (table.total() > 0) {
    coincidence.set_paired_share(static_cast<double>(paired) / static_cast<double>(table.total()));
  }
  return coincidence;
}

}  // namespace maneuver::evaluation
