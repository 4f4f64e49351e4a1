#include "model/evaluation/cross_validation_parts.h"

#include <google/protobuf/util/message_differencer.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace maneuver::evaluation {
namespace {

using google::protobuf::util::MessageDifferencer;
using Recordings = google::protobuf::RepeatedPtrField<v1::GroupedRecording>;
using RunKey = std::pair<int64_t, int>;  // seed, fold

// Returns "seed 1, fold 2", with folds counted from 1.
std::string Describe(const v1::FoldRun& run) {
  return absl::StrCat("seed ", run.seed(), ", fold ", run.fold() + 1);
}

absl::Status Contradiction(const v1::FoldRun& run, const std::string& what) {
  return absl::DataLossError(absl::StrCat(Describe(run), ": ", what));
}

// Whether a number can be a probability; sums of some are a little beyond 1.
bool IsProbability(double value) { return value >= -1e-6 && value <= 1.0 + 1e-6; }

absl::Status CheckSet(const v1::FoldRun& run, const v1::MeasuredSet& set,
                      const Recordings& recordings) {
  for (const v1::MeasuredExample& example : set.examples()) {
    if (example.recording() < 0 || example.recording() >= recordings.size()) {
      return Contradiction(run, "an example is of a recording that the plan does not have");
    }
    if (example.values_size() != set.value_names_size() ||
        example.strata_size() != set.dimensions_size()) {
      return Contradiction(run, "an example lacks values");
    }
    for (int i = 0; i < set.value_names_size(); ++i) {
      if (std::isfinite(example.values(i))) continue;
      return Contradiction(run,
                           absl::StrCat("an example's ", set.value_names(i), " is not finite"));
    }
    if (!IsProbability(example.confidence()) || !IsProbability(example.responsibility())) {
      return Contradiction(run, "an example has a probability beyond 0 and 1");
    }
    for (int i = 0; i < set.dimensions_size(); ++i) {
      if (example.strata(i) < 0 || example.strata(i) >= set.dimensions(i).names_size()) {
        return Contradiction(run, "an example is in a stratum that has no name");
      }
    }
  }
  return set.examples().empty() ? Contradiction(run, "no example was measured") : absl::OkStatus();
}

absl::Status CheckDatasets(const v1::CrossValidationPlan& plan) {
  for (const v1::GroupedRecording& recording : plan.recordings()) {
    if (recording.dataset() >= 0 && recording.dataset() < std::max(1, plan.dataset_names_size())) {
      continue;
    }
    return absl::DataLossError(
        absl::StrCat("recording ", recording.scenario_id(), " is of a dataset that has no name"));
  }
  return absl::OkStatus();
}

absl::Status CheckGroups(const v1::FoldRun& run, const v1::CrossValidationPlan& plan) {
  std::set<int> learned;
  for (const int recording : run.learned()) {
    if (recording < 0 || recording >= plan.recordings_size()) {
      return Contradiction(run, "it learned from a recording that the plan does not have");
    }
    learned.insert(plan.recordings(recording).group());
  }
  for (const v1::MeasuredExample& example : run.held_out().examples()) {
    const v1::GroupedRecording& recording = plan.recordings(example.recording());
    if (learned.contains(recording.group()) || recording.fold() != run.fold()) {
      return Contradiction(run, absl::StrCat("recording ", recording.scenario_id(),
                                             " was measured by a model that learned from its group "
                                             "or is of another fold"));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckRun(const v1::FoldRun& run, const v1::CrossValidationPlan& plan) {
  if (run.tests_size() != plan.test_datasets_size()) {
    return Contradiction(run, "a test dataset was not measured");
  }
  if (absl::Status status = CheckSet(run, run.held_out(), plan.recordings()); !status.ok()) {
    return status;
  }
  for (int i = 0; i < run.tests_size(); ++i) {
    absl::Status status = CheckSet(run, run.tests(i), plan.test_datasets(i).recordings());
    if (!status.ok()) return status;
  }
  return CheckGroups(run, plan);
}

bool SameColumns(const v1::MeasuredSet& a, const v1::MeasuredSet& b) {
  return std::ranges::equal(a.value_names(), b.value_names()) &&
         std::ranges::equal(a.dimensions(), b.dimensions(),
                            [](const v1::StratumDimension& c, const v1::StratumDimension& d) {
                              return c.dimension() == d.dimension() &&
                                     std::ranges::equal(c.names(), d.names());
                            });
}

absl::Status CheckColumns(const v1::FoldRun& run, const v1::FoldRun& first) {
  bool same = SameColumns(run.held_out(), first.held_out());
  for (const v1::MeasuredSet& test : run.tests()) {
    same = same && SameColumns(test, first.held_out());
  }
  if (same) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat(
      Describe(run), " and ", Describe(first),
      " measured different metrics or strata; run all folds by one version of the program, all "
      "of them with --baselines or none"));
}

absl::Status CheckComplete(const std::map<RunKey, v1::FoldRun>& runs, int folds) {
  std::set<int64_t> seeds;
  for (const auto& [key, _] : runs) seeds.insert(key.first);
  for (const int64_t seed : seeds) {
    for (int fold = 0; fold < folds; ++fold) {
      if (runs.contains({seed, fold})) continue;
      return absl::FailedPreconditionError(absl::StrCat("seed ", seed, " lacks fold ", fold + 1,
                                                        " of ", folds, "; run it with --only-fold ",
                                                        fold + 1, " --seeds ", seed));
    }
  }
  return absl::OkStatus();
}

// Checks that the folds partition the examples, so that each seed measures each example once.
absl::Status CheckSameExamples(const std::map<RunKey, v1::FoldRun>& runs) {
  std::map<int64_t, int64_t> examples;  // of each seed
  for (const auto& [key, run] : runs) examples[key.first] += run.held_out().examples_size();
  for (const auto& [seed, count] : examples) {
    if (count == examples.begin()->second) continue;
    return absl::FailedPreconditionError(absl::StrCat(
        "seed ", seed, " measured ", count, " examples and seed ", examples.begin()->first, " ",
        examples.begin()->second, "; run all folds on the same datasets"));
  }
  return absl::OkStatus();
}

}  // namespace

bool SamePlan(v1::CrossValidationPlan a, v1::CrossValidationPlan b) {
  for (v1::CrossValidationPlan* plan : {&a, &b}) {
    plan->clear_seeds();
    plan->clear_dataset_names();
    for (v1::GroupedRecording& recording : *plan->mutable_recordings()) recording.clear_dataset();
  }
  return MessageDifferencer::Equals(a, b);
}

absl::StatusOr<v1::CrossValidationPart> MergeParts(std::vector<v1::CrossValidationPart> parts) {
  if (parts.empty()) return absl::InvalidArgumentError("there is no part to merge");
  v1::CrossValidationPart merged;
  *merged.mutable_plan() = parts.front().plan();
  if (absl::Status status = CheckDatasets(merged.plan()); !status.ok()) return status;
  std::map<RunKey, v1::FoldRun> runs;
  for (v1::CrossValidationPart& part : parts) {
    if (!SamePlan(part.plan(), merged.plan())) {
      return absl::FailedPreconditionError(
          "the parts are of different cross-validations: their settings, datasets, folds or "
          "--fold-seed differ");
    }
    for (v1::FoldRun& run : *part.mutable_runs()) {
      if (absl::Status status = CheckRun(run, merged.plan()); !status.ok()) return status;
      const RunKey key(run.seed(), run.fold());
      const std::string name = Describe(run);
      const auto [place, added] = runs.try_emplace(key, std::move(run));
      if (!added) {
        return absl::FailedPreconditionError(
            absl::StrCat("two parts have ", name, "; leave one of them out"));
      }
      absl::Status status = CheckColumns(place->second, runs.begin()->second);
      if (!status.ok()) return status;
    }
  }
  if (runs.empty()) return absl::FailedPreconditionError("the parts hold no fold");
  if (absl::Status status = CheckComplete(runs, merged.plan().folds()); !status.ok()) return status;
  if (absl::Status status = CheckSameExamples(runs); !status.ok()) return status;
  merged.mutable_plan()->clear_seeds();
  for (auto& [key, run] : runs) {
    const auto& seeds = merged.plan().seeds();
    if (seeds.empty() || *seeds.rbegin() != key.first) merged.mutable_plan()->add_seeds(key.first);
    *merged.add_runs() = std::move(run);
  }
  return merged;
}

}  // namespace maneuver::evaluation
