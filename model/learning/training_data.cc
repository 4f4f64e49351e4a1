#include "model/learning/training_data.h"

#include <algorithm>
#include <iterator>
#include <string>
#include <unordered_set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "model/artifact/calibration_examples.h"
#include "model/artifact/model_spec.h"
#include "model/data/dataset_folder.h"
#include "model/data/recording_blocks.h"
#include "model/data/recording_split.h"
#include "model/data/stable_hash.h"
#include "model/learning/training_failure.h"
#include "model/learning/training_labels.h"

namespace maneuver::learning {
namespace {

// Whether anything is learned, and not only calibrated.
bool Learns(const v1::TrainingSettings& settings) {
  return settings.optimization().joint_epochs() > 0;
}

// Adds recordings one by one to the side of the split that they belong to.
class Splitter {
 public:
  explicit Splitter(const v1::TrainingSettings& settings)
      : settings_(settings), training_examples_(TrainingExampleSettings(settings)) {}

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

  bool HoldsOut(const std::string& scenario_id) const {
    return held_out_ids_.contains(scenario_id);
  }
  int64_t TrainingExamples() const { return static_cast<int64_t>(data_.training.examples.size()); }
  // Labels of the training examples, after Finish; null without any.
  const std::shared_ptr<const TrainingLabels>& labels() const { return labels_; }

  absl::StatusOr<TrainingData> Finish() {
    const int64_t found = TrainingExamples();
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

  absl::Status LabelExamples() {
    if (training_annotations_.empty()) return absl::OkStatus();
    const auto labels = TrainingLabels::Make(std::move(training_annotations_), settings_);
    if (!labels.ok()) return labels.status();
    data_.label_names = (*labels)->names();
    for (const data::Example& example : data_.training.examples) {
      const size_t recording = static_cast<size_t>(example.recording);
      data_.labels.push_back(
          (*labels)->Of(data_.training.recordings[recording].scenario_id(), example));
    }
    labels_ = *labels;
    return absl::OkStatus();
  }

  absl::Status TooFew(int64_t found, int64_t needed) const {
    const std::string types = artifact::TargetTypesText(settings_.model());
    const std::string remedy =
        targets_ == 0 ? "None of their agents is of a type that the model learns from: check "
                        "model.target_types and `maneuver dataset show`"
        : !Learns(settings_)
            ? "Collect more outcomes, or make examples.stride smaller"
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
  std::shared_ptr<const TrainingLabels> labels_;
  int64_t recordings_ = 0;
  int64_t targets_ = 0;  // agents of the types that are learned from
};

// The recordings of a folder that a run over large data keeps in memory: indices into its
// RecordingIndex, ascending. At least one of each side, where there is one.
//   memory: bytes, of which training recordings take a quarter and held-out ones an eighth
std::vector<size_t> SampleRecordings(const RecordingWindows& windows, int folder,
                                     const v1::TrainingSettings& settings, double memory,
                                     const LearnsFrom& learns_from) {
  const auto& entries = windows.index(folder).entries();
  const double share = settings.examples().validation_share();
  std::vector<size_t> sample;
  const auto take = [&](std::vector<size_t> side, double left) {
    std::ranges::sort(side, {}, [&](size_t i) {
      return std::pair(data::MixHash(data::StableHash(entries[i].scenario_id),
                                     static_cast<uint64_t>(settings.seed())),
                       i);
    });
    for (size_t i = 0; i < side.size() && left > 0.0; ++i) {
      left -= static_cast<double>(data::kMemoryPerByte) *
              static_cast<double>(entries[side[i]].payload_bytes);
      sample.push_back(side[i]);
    }
  };
  std::vector<size_t> training;
  for (const UnreadRecording& each : windows.recordings()) {
    if (each.folder == folder) training.push_back(each.index);
  }
  std::vector<size_t> held_out;
  for (size_t i = 0; i < entries.size(); ++i) {
    const std::string& id = entries[i].scenario_id;
    if (data::HeldOut(id, share) && (!learns_from || learns_from(id))) held_out.push_back(i);
  }
  take(std::move(training), memory / 4.0);
  take(std::move(held_out), memory / 8.0);
  std::ranges::sort(sample);
  return sample;
}

// Returns the bytes on disk of the recordings of a folder that are learned from.
absl::StatusOr<int64_t> LearnedBytes(const std::filesystem::path& folder,
                                     const LearnsFrom& learns_from) {
  if (!learns_from) return data::RecordingBytes(folder);
  const absl::StatusOr<data::RecordingIndex> index = data::RecordingIndex::Open(folder);
  if (!index.ok()) return index.status();
  int64_t bytes = 0;
  for (const data::RecordingIndex::Entry& entry : index->entries()) {
    if (learns_from(entry.scenario_id)) bytes += static_cast<int64_t>(entry.payload_bytes);
  }
  return bytes;
}

absl::Status CheckExamples(int64_t all, int64_t sampled, const v1::TrainingSettings& settings) {
  const int64_t needed = MinimumExamples(settings);
  if (sampled >= needed) return absl::OkStatus();
  const std::string remedy =
      all >= needed ? "raise --data-memory"
      : Learns(settings)
          ? "add recordings, make examples.stride smaller, or lower model.actions and "
            "optimization.batch_size"
          : "collect more outcomes, or make examples.stride smaller";
  return WithFailure(
      absl::FailedPreconditionError(absl::StrFormat(
          "the recordings hold %d training examples, the sample of them that fits in the data "
          "memory %d, and %d are needed; %s",
          all, sampled, needed, remedy)),
      TrainingFailure::kNotEnoughExamples);
}

// Adds the sample of a folder, and the annotations of the sample and of all training recordings.
absl::Status AddSample(const std::filesystem::path& path, const RecordingWindows& windows,
                       std::span<const size_t> sample, int folder,
                       const v1::TrainingSettings& settings,
                       const std::function<bool()>& keep_going, const LearnsFrom& learns_from,
                       Splitter& splitter) {
  for (const size_t recording : sample) {
    if (!keep_going()) return absl::CancelledError("stopped while reading the recordings");
    absl::StatusOr<v1::Scenario> read = windows.index(folder).Read(recording);
    if (!read.ok()) return read.status();
    splitter.Add(*std::move(read));
  }
  const double share = settings.examples().validation_share();
  return data::ForEachAnnotation(
      path, data::OnDamage::kStop, [&](v1::ManeuverAnnotation&& annotation) {
        const std::string& id = annotation.scenario_id();
        const bool learned = !learns_from || learns_from(id);
        if (learned && (splitter.HoldsOut(id) || !data::HeldOut(id, share))) {
          splitter.Add(std::move(annotation));
        }
        return true;
      });
}

absl::StatusOr<TrainingData> OpenLargeData(std::span<const std::filesystem::path> folders,
                                           const v1::TrainingSettings& settings,
                                           int64_t data_memory, int threads,
                                           const std::function<bool()>& keep_going,
                                           const LearnsFrom& learns_from) {
  const auto windows =
      RecordingWindows::Open(folders, settings, data_memory, threads, keep_going, learns_from);
  if (!windows.ok()) return windows.status();
  int64_t all_bytes = 0;
  for (size_t i = 0; i < folders.size(); ++i) all_bytes += (*windows)->bytes(static_cast<int>(i));
  Splitter splitter(settings);
  for (size_t i = 0; i < folders.size(); ++i) {
    const int folder = static_cast<int>(i);
    const double share = static_cast<double>((*windows)->bytes(folder)) /
                         static_cast<double>(std::max<int64_t>(1, all_bytes));
    const std::vector<size_t> sample = SampleRecordings(
        **windows, folder, settings, share * static_cast<double>(data_memory), learns_from);
    const absl::Status added = AddSample(folders[i], **windows, sample, folder, settings,
                                         keep_going, learns_from, splitter);
    if (!added.ok()) return added;
    splitter.EndFolder();
  }
  const absl::Status enough =
      CheckExamples((*windows)->examples(), splitter.TrainingExamples(), settings);
  if (!enough.ok()) return enough;
  absl::StatusOr<TrainingData> data = splitter.Finish();
  if (!data.ok()) return data;
  (*windows)->SetLabels(splitter.labels());
  data->windows = *windows;
  return data;
}

}  // namespace

int64_t TrainingData::TrainingExamples() const {
  return windows ? windows->examples() : static_cast<int64_t>(training.examples.size());
}

int64_t MinimumExamples(const v1::TrainingSettings& settings) {
  if (!Learns(settings)) return artifact::kFewestHeldOut;
  return 2 * std::max(settings.model().actions(), settings.optimization().batch_size());
}

absl::StatusOr<TrainingData> LoadTrainingData(std::span<const std::filesystem::path> folders,
                                              const v1::TrainingSettings& settings,
                                              const std::function<bool()>& keep_going,
                                              const LearnsFrom& learns_from) {
  Splitter splitter(settings);
  std::unordered_set<std::string> left_out;  // ids
  bool stopped = false;
  for (const std::filesystem::path& folder : folders) {
    absl::Status status =
        data::ForEachScenario(folder, data::OnDamage::kStop, [&](v1::Scenario&& recording) {
          if (learns_from && !learns_from(recording.scenario_id())) {
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
  return splitter.Finish();
}

absl::StatusOr<TrainingData> OpenTrainingData(std::span<const std::filesystem::path> folders,
                                              const v1::TrainingSettings& settings,
                                              int64_t data_memory, int threads,
                                              const std::function<bool()>& keep_going,
                                              const LearnsFrom& learns_from) {
  int64_t bytes = 0;
  for (const std::filesystem::path& folder : folders) {
    const absl::StatusOr<int64_t> of_folder = LearnedBytes(folder, learns_from);
    if (!of_folder.ok()) return of_folder.status();
    bytes += *of_folder;
  }
  absl::StatusOr<TrainingData> data =
      data::FitInMemory(bytes, data_memory)
          ? LoadTrainingData(folders, settings, keep_going, learns_from)
          : OpenLargeData(folders, settings, data_memory, threads, keep_going, learns_from);
  if (data.ok()) data->data_memory = data_memory;
  return data;
}

absl::StatusOr<TrainingData> SplitRecordings(std::vector<v1::Scenario> recordings,
                                             const v1::TrainingSettings& settings) {
  Splitter splitter(settings);
  for (v1::Scenario& recording : recordings) splitter.Add(std::move(recording));
  splitter.EndFolder();
  return splitter.Finish();
}

}  // namespace maneuver::learning
