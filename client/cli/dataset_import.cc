#include "client/cli/dataset_import.h"

#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <deque>
#include <future>
#include <map>
#include <memory>
#include <ostream>
#include <semaphore>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/interrupt.h"
#include "client/cli/progress_line.h"
#include "client/cli/text_format.h"
#include "model/data/dataset_folder.h"
#include "model/data/dataset_manifest.h"
#include "model/data/recording_split.h"
#include "model/files/durable_file.h"
#include "model/machine/usable_cores.h"
#include "model/scene/scenario_validation.h"

namespace maneuver::cli {
namespace {

namespace fs = std::filesystem;

constexpr int kMostSaid = 20;  // problems that are listed

std::string TimeLeft(double seconds) {
  const auto whole = static_cast<int64_t>(seconds + 0.5);
  return whole < 60 ? absl::StrCat(whole, " s left") : absl::StrCat(whole / 60, " min left");
}

class Import final : public ImportSink {
 public:
  Import(const ImportArguments& arguments, const ImportFormat& format, data::DatasetWriter& writer,
         const Interrupt& interrupt, Environment& environment)
      : arguments_(arguments),
        format_(format),
        writer_(writer),
        environment_(environment),
        interrupt_(interrupt),
        progress_(environment.errors, environment.progress_form()),
        threads_(arguments.threads.value_or(machine::UsableCores())),
        ahead_(2 * static_cast<size_t>(threads_)),
        free_threads_(static_cast<std::ptrdiff_t>(threads_)) {}

  absl::StatusOr<v1::Dataset> Run(const std::vector<ImportFile>& files) {
    absl::StatusOr<v1::Dataset> dataset = Write(files);
    progress_.Clear();
    return dataset;
  }

  absl::Status Take(RawRecording&& recording) override {
    if (interrupt_.happened()) return absl::CancelledError("interrupted");
    recording.end += before_file_;
    Begin(std::move(recording));
    while (parsing_.size() > ahead_) {
      absl::Status status = TakeFirst();
      if (!status.ok()) return status;
    }
    return absl::OkStatus();
  }
  absl::Status Damaged(const absl::Status& damage) override {
    if (arguments_.on_damage == "stop") return damage;
    ++damaged_;
    Say(absl::StrCat(std::string(damage.message()), "; skipped"));
    return absl::OkStatus();
  }
  void Note(const std::string& text) override { Say(text); }
  void ShowProgress(double bytes) override { Progress(before_file_ + bytes); }

  bool complete() const { return damaged_ == 0 && refused_ == 0; }

  // What was not taken as it was, for people.
  std::string Report() const {
    std::string text;
    if (damaged_ > 0) absl::StrAppend(&text, "damaged records skipped: ", damaged_, "\n");
    if (refused_ > 0) absl::StrAppend(&text, "unusable recordings skipped: ", refused_, "\n");
    if (renamed_ > 0) {
      absl::StrAppend(&text, HowMany(renamed_, "recording"),
                      " with an id seen before got a suffix (\"#2\")\n");
    }
    return text;
  }

  // How long it took, and the most memory this process ever had.
  std::string Effort() const {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return absl::StrCat("read in ", Fixed(Passed(), 1), " s, ", Rate(),
                        " recordings a second, with ", usage.ru_maxrss / 1024,
                        " MB of memory at peak");
  }

 private:
  absl::StatusOr<v1::Dataset> Write(const std::vector<ImportFile>& files) {
    for (const ImportFile& file : files) total_bytes_ += file.bytes;
    for (const ImportFile& file : files) {
      absl::Status status = format_.read(file.path, *this);
      if (!status.ok()) return status;
      before_file_ += file.bytes;
    }
    while (!parsing_.empty()) {
      absl::Status status = TakeFirst();
      if (!status.ok()) return status;
    }
    if (recordings_ == 0) {
      return absl::InvalidArgumentError(
          absl::StrCat("none of the files holds a usable ", format_.name));
    }
    return writer_.Commit();
  }

  double Passed() const {  // seconds
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }
  std::string Rate() const {
    return Fixed(static_cast<double>(recordings_) / std::max(Passed(), 1e-3), 0);
  }

  struct Parsed {
    absl::StatusOr<v1::Scenario> scenario;
    std::string problem;  // of one that parses; empty: none
  };
  struct Pending {
    std::string place;
    double end = 0.0;
    std::future<Parsed> parsed;
  };

  void Begin(RawRecording&& recording) {
    Pending& pending = parsing_.emplace_back();
    pending.place = std::move(recording.place);
    pending.end = recording.end;
    pending.parsed = std::async(std::launch::async, [this, parse = std::move(recording.parse)] {
      free_threads_.acquire();
      Parsed parsed{parse(), ""};
      free_threads_.release();
      if (!parsed.scenario.ok()) return parsed;
      const auto violations = scene::ValidateScenario(*parsed.scenario, scene::ScenarioLimits());
      if (!violations.empty()) {
        parsed.problem = absl::StrCat(parsed.scenario->scenario_id(), ": ", violations[0].field,
                                      ": ", violations[0].description);
      }
      return parsed;
    });
  }

  absl::Status TakeFirst() {
    Pending pending = std::move(parsing_.front());
    parsing_.pop_front();
    Parsed parsed = pending.parsed.get();
    absl::StatusOr<v1::Scenario>& scenario = parsed.scenario;
    if (!scenario.ok()) return Refuse(pending.place, std::string(scenario.status().message()));
    if (!parsed.problem.empty()) return Refuse(pending.place, parsed.problem);
    if (scenario->scenario_id().empty()) {
      scenario->set_scenario_id(absl::StrCat("unnamed-", recordings_ + refused_));
    }
    // As a part, which keeps it on the same side of the validation split.
    std::string id = scenario->scenario_id();
    while (!names_.insert(id).second) {
      id = data::PartId(scenario->scenario_id(), ++times_seen_[scenario->scenario_id()] + 1);
    }
    if (id != scenario->scenario_id()) {
      scenario->set_scenario_id(id);
      if (!scene::ValidateScenario(*scenario, scene::ScenarioLimits()).empty()) {
        return Refuse(pending.place, "its id was seen before, and is too long for a suffix");
      }
      ++renamed_;
    }
    ++recordings_;
    absl::Status status = writer_.Add(*scenario);
    Progress(pending.end);
    return status;
  }

  absl::Status Refuse(const std::string& place, const std::string& reason) {
    const std::string text = absl::StrCat(place, ": ", reason);
    if (arguments_.strict) return absl::InvalidArgumentError(text);
    ++refused_;
    Say(absl::StrCat(text, "; skipped"));
    return absl::OkStatus();
  }

  void Say(const std::string& text) {
    if (++said_ > kMostSaid) return;
    progress_.Clear();
    environment_.err << Printable(text) << "\n";
    if (said_ == kMostSaid) environment_.err << "further ones are counted, not listed\n";
  }

  void Progress(double bytes) {
    const double left = Passed() * (total_bytes_ / std::max(bytes, 1.0) - 1.0);
    progress_.Show(bytes / std::max(total_bytes_, 1.0),
                   absl::StrCat(recordings_, " recordings, ", Rate(), " a second, ",
                                TimeLeft(std::max(left, 0.0))));
  }

  const ImportArguments& arguments_;
  const ImportFormat& format_;
  data::DatasetWriter& writer_;
  Environment& environment_;
  const Interrupt& interrupt_;
  ProgressLine progress_;
  const int64_t threads_;  // that parse at once
  const size_t ahead_;     // recordings that are parsed, or wait to be, while one is written
  std::counting_semaphore<> free_threads_;
  std::deque<Pending> parsing_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  double total_bytes_ = 0.0;
  double before_file_ = 0.0;
  int64_t recordings_ = 0;
  int64_t refused_ = 0;
  int64_t damaged_ = 0;
  int64_t renamed_ = 0;
  int said_ = 0;                           // problems
  std::set<std::string> names_;            // of all recordings so far
  std::map<std::string, int> times_seen_;  // again, by id
};

}  // namespace

absl::StatusOr<std::vector<ImportFile>> FindFiles(const std::vector<std::string>& inputs,
                                                  const std::string& extension) {
  std::vector<ImportFile> files;
  const auto add = [&files](const fs::path& file) {
    std::error_code error;
    const auto bytes = fs::file_size(file, error);
    files.push_back({file, error ? 0.0 : static_cast<double>(bytes)});
  };
  for (const std::string& input : inputs) {
    std::error_code error;
    if (!fs::is_directory(input, error)) {
      if (!fs::is_regular_file(input, error)) {
        return absl::NotFoundError(
            absl::StrCat(input, fs::exists(input, error) ? " is not a file" : " does not exist",
                         "; name files or folders of them"));
      }
      add(input);
      continue;
    }
    if (fs::exists(fs::path(input) / data::kManifestFile, error)) {
      return absl::InvalidArgumentError(absl::StrCat(
          input, " is a dataset already; upload it (maneuver dataset upload) or use it as it is"));
    }
    const auto entries = files::ListFolder(input);
    if (!entries.ok()) return entries.status();
    const size_t before = files.size();
    for (const fs::path& entry : *entries) {
      if (!fs::is_regular_file(entry, error) || entry.filename().string().front() == '.') continue;
      if (extension.empty() || entry.extension() == extension) add(entry);
    }
    if (files.size() == before) {
      return absl::NotFoundError(absl::StrCat(input, " holds no files to import"));
    }
  }
  return files;
}

void AddImportOptions(Command& command, ImportArguments& arguments, const std::string& what) {
  command.Argument("OUT_DIR", &arguments.folder, "Folder to write; must not exist");
  command.Arguments("FILE", &arguments.inputs, what);
  command.Choice("--on-damage", &arguments.on_damage, {"stop", "skip"},
                 "What to do with a damaged record");
  command.Flag("--strict", &arguments.strict, "Stop at a recording that cannot be used");
  command.Option("--origin", &arguments.origin, "Text to store as the dataset's origin");
  command.Option("--threads", &arguments.threads, 1, 1024,
                 "Number of recordings to parse at once [one for each core]");
}

int RunImport(const ImportArguments& arguments, const ImportFormat& format,
              Environment& environment) {
  const absl::StatusOr<std::vector<ImportFile>> files = format.find(arguments.inputs);
  if (!files.ok()) return environment.Refuse(std::string(files.status().message()));
  const Interrupt interrupt([] {});  // before the folder, so that Ctrl-C leaves nothing of it
  auto writer = data::DatasetWriter::Create(arguments.folder, arguments.origin);
  if (!writer.ok()) return environment.FailAt(arguments.folder, writer.status());
  Import import(arguments, format, **writer, interrupt, environment);
  const absl::StatusOr<v1::Dataset> dataset = import.Run(*files);
  environment.err << import.Report();
  if (!dataset.ok()) return environment.Fail(dataset.status());
  if (environment.json()) {
    environment.PrintJson(*dataset);
  } else {
    environment.out << arguments.folder << ": " << HowMany(dataset->recordings(), "recording")
                    << ", " << Spell(dataset->duration_seconds()) << " of driving\n";
    environment.err << import.Effort() << "\n";
  }
  return import.complete() ? kOk : kFailed;
}

}  // namespace maneuver::cli
