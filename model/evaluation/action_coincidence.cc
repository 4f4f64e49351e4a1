#include "model/evaluation/action_coincidence.h"

#include <set>
#include <tuple>

#include "model/evaluation/action_matching.h"
#include "model/evaluation/calibration.h"
#include "model/evaluation/clustering.h"

namespace maneuver::evaluation {
namespace {

// Adds the pairs of actions of the examples that both models have: models that look back
// differently far do not have the same ones.
void AddPairs(const MeasuredExamples& ours, const MeasuredExamples& theirs, ActionPairs& pairs) {
  const auto key = [](const data::Example& example) {
    return std::tuple(example.recording, example.target_id, example.time);
  };
  std::map<std::tuple<int, int64_t, double>, int> action_of;
  for (size_t i = 0; i < ours.examples.size(); ++i) {
    action_of[key(ours.examples[i])] = ours.measured[i].action;
  }
  for (size_t i = 0; i < theirs.examples.size(); ++i) {
    const auto found = action_of.find(key(theirs.examples[i]));
    if (found == action_of.end()) continue;
    ++pairs[{found->second, theirs.measured[i].action}];
  }
}

// One of the models, on all recordings.
struct MeasuredModel {
  MeasuredModel(const inference::ActionModel& model, const EvaluationInput& input)
      : measurer(model, input), statistics(model.spec().actions()) {}

  absl::StatusOr<MeasuredExamples> Measure(std::span<const v1::Scenario> block) {
    absl::StatusOr<MeasuredExamples> all = measurer.Measure(block);
    if (!all.ok()) return all;
    for (const Measurement& each : all->measured) {
      statistics.Add(each.probabilities, each.responsibilities);
    }
    return all;
  }

  BlockMeasurer measurer;
  ActionStatistics statistics;
};

}  // namespace

absl::StatusOr<v1::ActionMatching> MeasureMatching(const inference::ActionModel& first,
                                                   const inference::ActionModel& second,
                                                   const EvaluationInput& input) {
  MeasuredModel ours(first, input);
  MeasuredModel theirs(second, input);
  ActionPairs pairs;
  absl::Status status = ForEachBlock(input, [&](std::span<const v1::Scenario> block) {
    const absl::StatusOr<MeasuredExamples> of_first = ours.Measure(block);
    if (!of_first.ok()) return of_first.status();
    const absl::StatusOr<MeasuredExamples> of_second = theirs.Measure(block);
    if (!of_second.ok()) return of_second.status();
    AddPairs(*of_first, *of_second, pairs);
    return absl::OkStatus();
  });
  if (status.ok()) status = ours.measurer.CheckExamples();
  if (status.ok()) status = theirs.measurer.CheckExamples();
  if (!status.ok()) return status;
  absl::StatusOr<v1::ActionMatching> matching =
      MatchActions(first.manifest(), ours.statistics.MeanProbability(), second.manifest(),
                   theirs.statistics.MeanProbability());
  if (!matching.ok()) return matching;
  *matching->mutable_coincidence() = CoincidenceOf(pairs, *matching);
  return matching;
}

v1::ActionCoincidence CoincidenceOf(const ActionPairs& pairs, const v1::ActionMatching& matching) {
  std::set<std::pair<int, int>> partners;
  for (const v1::ActionPair& pair : matching.pairs()) {
    partners.emplace(pair.first().action_id(), pair.second().action_id());
  }
  ContingencyTable table;
  int64_t paired = 0;
  for (const auto& [pair, examples] : pairs) {
    table.Add(pair.first, pair.second, examples);
    if (partners.contains(pair)) paired += examples;
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
