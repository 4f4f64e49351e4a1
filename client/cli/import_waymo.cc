// maneuver import waymo: Waymo Open Motion TFRecords as a dataset folder.

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <ostream>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/progress_line.h"
#include "client/cli/text_format.h"
#include "model/data/dataset_folder.h"
#include "model/data/tfrecord.h"
#include "model/data/waymo_reader.h"
#include "model/scene/scenario_validation.h"

namespace maneuver::cli {
namespace {

namespace fs = std::filesystem;

struct ImportArguments {
  std::string folder;
  std::vector<std::string> inputs;
  std::string on_damage = "stop";
  bool strict = false;
  std::string origin = "Waymo Open Motion";
};

// The files that the inputs name: those of a folder by name, hidden ones left out.
absl::StatusOr<std::vector<fs::path>> InputFiles(const std::vector<std::string>& inputs) {
  std::vector<fs::path> files;
  for (const std::string& input : inputs) {
    std::error_code error;
    if (!fs::is_directory(input, error)) {
      if (!fs::is_regular_file(input, error)) {
        return absl::NotFoundError(
            absl::StrCat(input, " does not exist; name TFRecord files or folders of them"));
      }
      files.emplace_back(input);
      continue;
    }
    std::vector<fs::path> found;
    for (const fs::directory_entry& entry : fs::directory_iterator(input, error)) {
      if (entry.is_regular_file(error) && entry.path().filename().string().front() != '.') {
        found.push_back(entry.path());
      }
    }
    if (found.empty()) {
      return absl::NotFoundError(absl::StrCat(input, " holds no files to import"));
    }
    std::sort(found.begin(), found.end());
    files.insert(files.end(), found.begin(), found.end());
  }
  return files;
}

class WaymoImport {
 public:
  WaymoImport(const ImportArguments& arguments, Environment& environment)
      : arguments_(arguments),
        environment_(environment),
        progress_(environment.err, environment.interactive) {}

  absl::StatusOr<v1::Dataset> Run(data::DatasetWriter& writer, const std::vector<fs::path>& files) {
    for (const fs::path& file : files) {
      total_bytes_ += static_cast<double>(fs::file_size(file));
    }
    for (const fs::path& file : files) {
      absl::Status status = ReadFile(file, writer);
      if (!status.ok()) return status;
      finished_bytes_ += static_cast<double>(fs::file_size(file));
    }
    progress_.Clear();
    if (recordings_ == 0) {
      return absl::InvalidArgumentError("none of the records is a usable Waymo scenario");
    }
    return writer.Commit();
  }

  bool complete() const { return damaged_ == 0 && refused_ == 0; }

  // What was not taken as it was, for people.
  std::string Report() const {
    std::string text;
    if (damaged_ > 0) absl::StrAppend(&text, "damaged records skipped: ", damaged_, "\n");
    if (refused_ > 0) absl::StrAppend(&text, "unusable recordings skipped: ", refused_, "\n");
    if (renamed_ > 0) {
      absl::StrAppend(&text, renamed_,
                      " recordings with an id seen before got a suffix (\"#2\")\n");
    }
    return text;
  }

 private:
  absl::Status ReadFile(const fs::path& file, data::DatasetWriter& writer) {
    auto reader = data::TfRecordReader::Open(file);
    if (!reader.ok()) return reader.status();
    std::string payload;
    while (true) {
      absl::Status status = (*reader)->Next(&payload);
      if (absl::IsOutOfRange(status)) return absl::OkStatus();
      if (!status.ok()) {
        if (arguments_.on_damage == "stop" || !absl::IsDataLoss(status)) return status;
        ++damaged_;
        Say(std::string(status.message()));
        if (!(*reader)->can_continue()) return absl::OkStatus();
        continue;
      }
      const std::string place =
          absl::StrCat(file.filename().string(), " at offset ", (*reader)->offset());
      status = TakeRecord(payload, place, writer);
      if (!status.ok()) return status;
      Progress(static_cast<double>((*reader)->offset()));
    }
  }

  absl::Status TakeRecord(const std::string& payload, const std::string& place,
                          data::DatasetWriter& writer) {
    absl::StatusOr<v1::Scenario> scenario = data::ParseWaymoScenario(payload);
    if (!scenario.ok()) return Refuse(place, std::string(scenario.status().message()));
    if (scenario->scenario_id().empty()) {
      scenario->set_scenario_id(absl::StrCat("unnamed-", recordings_ + refused_));
    }
    const auto violations = scene::ValidateScenario(*scenario, scene::ScenarioLimits());
    if (!violations.empty()) {
      return Refuse(place, absl::StrCat(scenario->scenario_id(), ": ", violations[0].field, ": ",
                                        violations[0].description));
    }
    // Parts of one place share the id up to '#', which keeps them on one side of the split.
    const int part = ++times_seen_[scenario->scenario_id()];
    if (part > 1) {
      scenario->set_scenario_id(absl::StrCat(scenario->scenario_id(), "#", part));
      ++renamed_;
    }
    ++recordings_;
    return writer.Add(*scenario);
  }

  absl::Status Refuse(const std::string& place, const std::string& reason) {
    const std::string text = absl::StrCat(place, ": ", reason);
    if (arguments_.strict) return absl::InvalidArgumentError(text);
    ++refused_;
    Say(text);
    return absl::OkStatus();
  }

  void Say(const std::string& text) {
    progress_.Clear();
    environment_.err << text << "; skipped\n";
  }

  void Progress(double offset) {
    const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - start_;
    const double rate = static_cast<double>(recordings_) / std::max(passed.count(), 1e-3);
    progress_.Show((finished_bytes_ + offset) / std::max(total_bytes_, 1.0),
                   absl::StrCat(recordings_, " recordings, ", Fixed(rate, 0), " a second"));
  }

  const ImportArguments& arguments_;
  Environment& environment_;
  ProgressLine progress_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  double total_bytes_ = 0.0;
  double finished_bytes_ = 0.0;
  int64_t recordings_ = 0;
  int64_t refused_ = 0;
  int64_t damaged_ = 0;
  int64_t renamed_ = 0;
  std::map<std::string, int> times_seen_;
};

int ImportWaymo(const ImportArguments& arguments, Environment& environment) {
  const absl::StatusOr<std::vector<fs::path>> files = InputFiles(arguments.inputs);
  if (!files.ok()) return environment.Refuse(std::string(files.status().message()));
  auto writer = data::DatasetWriter::Create(arguments.folder, arguments.origin);
  if (!writer.ok()) return environment.Fail(writer.status());
  WaymoImport import(arguments, environment);
  const absl::StatusOr<v1::Dataset> dataset = import.Run(**writer, *files);
  environment.err << import.Report();
  if (!dataset.ok()) return environment.Fail(dataset.status());
  if (environment.json()) {
    environment.PrintJson(*dataset);
  } else {
    environment.out << arguments.folder << ": " << dataset->recordings() << " recordings, "
                    << Spell(dataset->duration_seconds()) << " of driving\n";
  }
  return import.complete() ? kOk : kFailed;
}

}  // namespace

void AddImport(Command& root, Environment& environment) {
  Command import = root.Add("import", "Make a dataset of recordings in another format");
  const auto arguments = std::make_shared<ImportArguments>();
  Command command = import.Add(
      "waymo", "Waymo Open Motion scenarios (TFRecord, also gzipped)",
      "Recordings that fail validation are reported and left out; the exit status is then 1, and\n"
      "the dataset is written all the same.\n"
      "Example: maneuver import waymo waymo-training training/ --on-damage skip\n"
      "Then:    maneuver dataset upload waymo-training waymo-training");
  command.Argument("OUT_DIR", &arguments->folder, "Folder to write; must not exist");
  command.Arguments("FILE", &arguments->inputs, "TFRecord files, or folders of them");
  command.Choice("--on-damage", &arguments->on_damage, {"stop", "skip"},
                 "What to do at a damaged record");
  command.Flag("--strict", &arguments->strict, "Stop at a recording that fails validation");
  command.Option("--origin", &arguments->origin, "What to write down as the dataset's origin");
  command.Run([arguments, &environment] { return ImportWaymo(*arguments, environment); });
}

}  // namespace maneuver::cli
