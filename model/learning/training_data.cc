#include "model/learning/training_data.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <string>
#include <unordered_set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "model/artifact/model_spec.h"
#include "model/data/dataset_folder.h"
#include "model/data/recording_split.h"
#include "model/data/stable_hash.h"
#include "model/evaluation/maneuver_labels.h"
#include "model/learning/training_failure.h"

namespace maneuver::learning {
namespace {

// Adds recordings one by one to the side of the split that they belong to.
class Splitter {
 public:
  explicit Splitter(const v1::TrainingSettings& settings)
      : settings_(settings), training_examples_(settings.examples()) {
    if (!training_examples_.has_training_stride()) return;
    *training_examples_.mutable_stride() = training_examples_.training_stride();
  }

  void Add(v1::Scenario&& recording) {
    targets_ += std::count_if(recording.agents().begin(), recording.agents().end(),
                              [this](const v1::Agent& agent) {
                                return agent.type() != v1::AGENT_TYPE_UNSPECIFIED &&
                                       artifact::Predicts(settings_.model(), agent.type());
                              });
    const bool held_out =
        data::HeldOut(recording.scenario_id(), settings_.examples().validation_share());
    ExampleSet& side = held_out ? data_.validation : data_.training;
    std::vector<data::Example> found = data::EnumerateExamples(
        recording, static_cast<int>(side.recordings.size()), settings_.model(),
        held_out ? settings_.examples() : training_examples_);
    std::move(found.begin(), found.end(), std::back_inserter(side.examples));
    if (held_out) held_out_ids_.insert(recording.scenario_id());
    side.recordings.push_back(std::move(recording));
    ++recordings_;
  }

  void Add(v1::ManeuverAnnotation&& annotation) {
    if (held_out_ids_.contains(annotation.scenario_id())) {
      data_.annotations.push_back(std::move(annotation));
    } else if (settings_.examples().label_share() > 0.0) {
      training_annotations_.push_back(std::move(annotation));
    }
  }

  // The recordings from here on are another folder's.
  void EndFolder() {
    int64_t before = 0;
    for (const int64_t examples : data_.folder_examples) before += examples;
    data_.folder_examples.push_back(static_cast<int64_t>(data_.training.examples.size()) - before);
  }

  absl::StatusOr<TrainingData> Finish() && {
    const int64_t found = static_cast<int64_t>(data_.training.examples.size());
    const int64_t needed = MinimumExamples(settings_);
    if (found < needed) return TooFew(found, needed);
    if (absl::Status status = CheckWeights(); !status.ok()) return status;
    const absl::Status status = LabelExamples();
    if (!status.ok()) return status;
    return std::move(data_);
  }

 private:
  absl::Status CheckWeights() const {
    const auto& weights = settings_.examples().dataset_weights();
    if (weights.empty()) return absl::OkStatus();
    if (static_cast<size_t>(weights.size()) != data_.folder_examples.size()) {
      return absl::InvalidArgumentError(
          absl::StrCat("examples.dataset_weights has ", weights.size(), " weights for ",
                       data_.folder_examples.size(), " datasets; give each of them one"));
    }
    for (size_t i = 0; i < data_.folder_examples.size(); ++i) {
      if (data_.folder_examples[i] > 0) continue;
      return WithFailure(
          absl::FailedPreconditionError(absl::StrCat(
              "examples.dataset_weights[", i,
              "] is of a dataset that holds no training examples; leave that dataset out")),
          TrainingFailure::kNotEnoughExamples);
    }
    return absl::OkStatus();
  }

  // Seconds.
  double Horizon() const { return artifact::WaypointTimes(settings_.model().trajectory()).back(); }

  // Labels label_share of the training examples, chosen by a hash, so that the same ones are
  // labelled whatever else is in the datasets.
  absl::Status LabelExamples() {
    if (training_annotations_.empty()) return absl::OkStatus();
    const evaluation::ManeuverLabels recorded(training_annotations_);
    const std::vector<std::string>& names = recorded.names();
    if (static_cast<int>(names.size()) > settings_.model().actions()) {
      return absl::FailedPreconditionError(
          absl::StrCat("the recordings are labelled with ", names.size(),
                       " different manoeuvres; raise model.actions (", settings_.model().actions(),
                       ") to as many, or set examples.label_share to 0"));
    }
    data_.label_names = names;
    std::sort(data_.label_names.begin(), data_.label_names.end());
    for (const data::Example& example : data_.training.examples) {
      const std::string& id =
          data_.training.recordings[static_cast<size_t>(example.recording)].scenario_id();
      int label = -1;
      const uint64_t hash = data::MixHash(
          data::MixHash(data::StableHash(id), static_cast<uint64_t>(example.target_id)),
          static_cast<uint64_t>(std::llround(example.time * 1000.0)));
      // Once more, so that it does not choose as the drawing of standing vehicles does.
      if (data::UnitInterval(data::MixHash(hash, 1)) < settings_.examples().label_share()) {
        const std::optional<int> found =
            recorded.Over(id, example.target_id, example.time, example.time + Horizon());
        if (found) {
          const auto place = std::lower_bound(data_.label_names.begin(), data_.label_names.end(),
                                              names[static_cast<size_t>(*found)]);
          label = static_cast<int>(place - data_.label_names.begin());
        }
      }
      data_.labels.push_back(label);
    }
    return absl::OkStatus();
  }

  absl::Status TooFew(int64_t found, int64_t needed) const {
    const std::string types = artifact::TargetTypesText(settings_.model());
    const std::string remedy =
        targets_ == 0
            ? "None of their agents is of a type that the model learns from: check "
              "model.target_types and `maneuver dataset show`"
            : "Add recordings, make model.trajectory.waypoints fewer (a shorter horizon) or "
              "examples.stride smaller, or lower model.actions and optimization.batch_size";
    return WithFailure(
        absl::FailedPreconditionError(absl::StrFormat(
            "%d recordings with %d %s hold %d training examples, and %d are needed: an agent with "
            "one second of past and %.1f s of future without gaps makes one. %s",
            recordings_, targets_, types, found, needed, Horizon(), remedy)),
        TrainingFailure::kNotEnoughExamples);
  }

  const v1::TrainingSettings& settings_;
  v1::ExampleSettings training_examples_;  // with the stride of training
  TrainingData data_;
  std::unordered_set<std::string> held_out_ids_;
  std::vector<v1::ManeuverAnnotation> training_annotations_;
  int64_t recordings_ = 0;
  int64_t targets_ = 0;  // agents of the types that are learned from
};

}  // namespace

int64_t MinimumExamples(const v1::TrainingSettings& settings) {
  return 2 * std::max(settings.model().actions(), settings.optimization().batch_size());
}

absl::StatusOr<TrainingData> LoadTrainingData(
    std::span<const std::filesystem::path> folders, const v1::TrainingSettings& settings,
    const std::function<bool()>& keep_going,
    const std::function<bool(const v1::Scenario&)>& learns_from) {
  Splitter splitter(settings);
  std::unordered_set<std::string> left_out;  // ids
  bool stopped = false;
  for (const std::filesystem::path& folder : folders) {
    absl::Status status =
        data::ForEachScenario(folder, data::OnDamage::kStop, [&](v1::Scenario&& recording) {
          if (learns_from && !learns_from(recording)) {
            left_out.insert(recording.scenario_id());
          } else {
            splitter.Add(std::move(recording));
          }
          stopped = !keep_going();
          return !stopped;
        });
    if (!status.ok()) return status;
    if (stopped) return absl::CancelledError("stopped while reading the recordings");
    status = data::ForEachAnnotation(folder, data::OnDamage::kStop,
                                     [&](v1::ManeuverAnnotation&& annotation) {
                                       if (!left_out.contains(annotation.scenario_id())) {
                                         splitter.Add(std::move(annotation));
                                       }
                                       return true;
                                     });
    if (!status.ok()) return status;
    splitter.EndFolder();
  }
  return std::move(splitter).Finish();
}

absl::StatusOr<TrainingData> SplitRecordings(std::vector<v1::Scenario> recordings,
                                             const v1::TrainingSettings& settings) {
  Splitter splitter(settings);
  for (v1::Scenario& recording : recordings) splitter.Add(std::move(recording));
  splitter.EndFolder();
  return std::move(splitter).Finish();
}

}  // namespace maneuver::learning
