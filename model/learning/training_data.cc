#include "model/learning/training_data.h"

#include <algorithm>
#include <iterator>
#include <string>
#include <unordered_set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "model/data/dataset_folder.h"

namespace maneuver::learning {
namespace {

// Adds recordings one by one to the side of the split that they belong to.
class Splitter {
 public:
  explicit Splitter(const v1::TrainingSettings& settings) : settings_(settings) {}

  void Add(v1::Scenario&& recording) {
    const bool held_out =
        data::HeldOut(recording.scenario_id(), settings_.examples().validation_share());
    ExampleSet& side = held_out ? data_.validation : data_.training;
    std::vector<data::Example> found =
        data::EnumerateExamples(recording, static_cast<int>(side.recordings.size()),
                                settings_.model(), settings_.examples());
    std::move(found.begin(), found.end(), std::back_inserter(side.examples));
    if (held_out) held_out_ids_.insert(recording.scenario_id());
    side.recordings.push_back(std::move(recording));
    ++recordings_;
  }

  void Add(v1::ManeuverAnnotation&& annotation) {
    if (held_out_ids_.contains(annotation.scenario_id())) {
      data_.annotations.push_back(std::move(annotation));
    }
  }

  absl::StatusOr<TrainingData> Finish() && {
    const int64_t found = static_cast<int64_t>(data_.training.examples.size());
    const int64_t needed = MinimumExamples(settings_);
    if (found < needed) return TooFew(found, needed);
    return std::move(data_);
  }

 private:
  absl::Status TooFew(int64_t found, int64_t needed) const {
    const v1::TrajectorySpec& trajectory = settings_.model().trajectory();
    const double horizon =
        trajectory.waypoints() * (static_cast<double>(trajectory.waypoint_interval().seconds()) +
                                  1e-9 * trajectory.waypoint_interval().nanos());
    return absl::FailedPreconditionError(absl::StrFormat(
        "%d recordings hold %d training examples, and %d are needed: a vehicle with one second of "
        "past and %.1f s of future without gaps makes one. Add recordings, make "
        "model.trajectory.waypoints fewer (a shorter horizon) or examples.stride smaller, or lower "
        "model.actions and optimization.batch_size",
        recordings_, found, needed, horizon));
  }

  const v1::TrainingSettings& settings_;
  TrainingData data_;
  std::unordered_set<std::string> held_out_ids_;
  int64_t recordings_ = 0;
};

}  // namespace

int64_t MinimumExamples(const v1::TrainingSettings& settings) {
  return 2 * std::max(settings.model().actions(), settings.optimization().batch_size());
}

absl::StatusOr<TrainingData> LoadTrainingData(std::span<const std::filesystem::path> folders,
                                              const v1::TrainingSettings& settings,
                                              const std::function<bool()>& keep_going) {
  Splitter splitter(settings);
  bool stopped = false;
  for (const std::filesystem::path& folder : folders) {
    absl::Status status =
        data::ForEachScenario(folder, data::OnDamage::kStop, [&](v1::Scenario&& recording) {
          splitter.Add(std::move(recording));
          stopped = !keep_going();
          return !stopped;
        });
    if (!status.ok()) return status;
    if (stopped) return absl::CancelledError("stopped while reading the recordings");
    status = data::ForEachAnnotation(folder, data::OnDamage::kStop,
                                     [&](v1::ManeuverAnnotation&& annotation) {
                                       splitter.Add(std::move(annotation));
                                       return true;
                                     });
    if (!status.ok()) return status;
  }
  return std::move(splitter).Finish();
}

absl::StatusOr<TrainingData> SplitRecordings(std::vector<v1::Scenario> recordings,
                                             const v1::TrainingSettings& settings) {
  Splitter splitter(settings);
  for (v1::Scenario& recording : recordings) splitter.Add(std::move(recording));
  return std::move(splitter).Finish();
}

}  // namespace maneuver::learning
