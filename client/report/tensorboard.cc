#include "client/report/tensorboard.h"

#include <map>
#include <memory>
#include <string>
#include <system_error>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "model/data/tfrecord.h"
#include "tensorboard_event.pb.h"

namespace maneuver::report {
namespace {

// TensorBoard finds event files by "tfevents" in their names, and sorts them by what follows.
constexpr char kEventFile[] = "events.out.tfevents.0000000000.maneuver";
constexpr char kFileVersion[] = "brain.Event:2";

double Seconds(const google::protobuf::Timestamp& time) {
  return static_cast<double>(time.seconds()) + 1e-9 * time.nanos();
}

template <typename Figures>
void AddEvent(const std::string& phase, const v1::JobProgress& epoch, const Figures& figures,
              std::vector<tensorboard::Event>* events) {
  if (figures.empty()) return;
  tensorboard::Event& event = events->emplace_back();
  event.set_wall_time(Seconds(epoch.time()));
  event.set_step(epoch.step());
  for (const auto& [term, value] : std::map<std::string, double>(figures.begin(), figures.end())) {
    tensorboard::Summary::Value* figure = event.mutable_summary()->add_value();
    figure->set_tag(absl::StrCat(phase, "/", term));
    figure->set_simple_value(static_cast<float>(value));
  }
}

absl::Status WriteRun(const std::vector<tensorboard::Event>& events,
                      const std::filesystem::path& folder) {
  if (events.empty()) return absl::OkStatus();
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  const std::filesystem::path file = folder / kEventFile;
  if (!error) std::filesystem::remove(file, error);
  if (error) {
    return absl::FailedPreconditionError(
        absl::StrCat("cannot write into the folder ", folder.string(), ": ", error.message()));
  }
  absl::StatusOr<std::unique_ptr<data::TfRecordWriter>> writer = data::TfRecordWriter::Create(file);
  if (!writer.ok()) {
    return absl::FailedPreconditionError(std::string(writer.status().message()));
  }
  tensorboard::Event opening;
  opening.set_wall_time(events.front().wall_time());
  opening.set_file_version(kFileVersion);
  absl::Status status = (*writer)->Append(opening.SerializeAsString());
  for (const tensorboard::Event& event : events) {
    if (status.ok()) status = (*writer)->Append(event.SerializeAsString());
  }
  if (status.ok()) status = (*writer)->Close();
  return status.ok() ? status : absl::FailedPreconditionError(std::string(status.message()));
}

}  // namespace

absl::Status WriteTensorBoard(std::span<const LearningPhase> phases,
                              const std::filesystem::path& folder) {
  std::vector<tensorboard::Event> training;
  std::vector<tensorboard::Event> held_out;
  std::vector<tensorboard::Event> mixture;
  for (const LearningPhase& phase : phases) {
    for (const v1::JobProgress& epoch : phase.epochs) {
      AddEvent(phase.name, epoch, epoch.epoch_report().training(), &training);
      AddEvent(phase.name, epoch, epoch.epoch_report().validation(), &held_out);
      AddEvent(phase.name, epoch, MixtureFigures(epoch.epoch_report()), &mixture);
    }
  }
  absl::Status status = WriteRun(training, folder / "training");
  if (status.ok()) status = WriteRun(held_out, folder / "held-out");
  if (status.ok()) status = WriteRun(mixture, folder / "mixture");
  return status;
}

}  // namespace maneuver::report
