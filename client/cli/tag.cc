// maneuver tag: which action did each target take, in all recordings of datasets? Here, or as a job
// of the server.

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <ostream>
#include <system_error>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "client/cli/commands.h"
#include "client/cli/interrupt.h"
#include "client/cli/job_display.h"
#include "client/cli/progress_line.h"
#include "client/cli/resource_names.h"
#include "client/cli/text_format.h"
#include "client/cli/transfer_line.h"
#include "google/protobuf/struct.pb.h"
#include "model/inference/action_model.h"
#include "model/machine/usable_cores.h"
#include "model/tags/tag_datasets.h"

namespace maneuver::cli {
namespace {

namespace fs = std::filesystem;

struct TagArguments {
  std::vector<std::string> datasets;
  std::string model;
  std::string output;
  std::string shards = "0/1";
  bool windows = false;
  std::optional<double> stride;
  std::string precision = "f32";
  int64_t threads = 0;
  std::string on_server;  // name of the tags there; empty: in this process
  std::optional<int64_t> priority;
  bool detach = false;
  bool validate_only = false;
};

// A folder that is removed at the end.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::error_code error;
    std::string pattern = (fs::temp_directory_path(error) / "maneuver-tag-XXXXXX").string();
    if (mkdtemp(pattern.data()) != nullptr) path_ = pattern;
  }
  ~ScratchFolder() {
    std::error_code error;
    if (!path_.empty()) fs::remove_all(path_, error);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  const fs::path& path() const { return path_; }  // empty: it could not be made

 private:
  fs::path path_;
};

// "town" is a model of the server also where a folder of that name, such as its dataset, is here.
bool IsModelFolder(const std::string& model) {
  std::error_code error;
  return model.starts_with('/') || model.starts_with('.') ||
         fs::exists(fs::path(model) / "model.json", error);
}

// Loads a model from its folder, or from the server that has it.
absl::StatusOr<std::shared_ptr<const inference::ActionModel>> LoadModel(
    const TagArguments& arguments, client::Cancellation& cancellation, Environment& environment) {
  inference::EngineOptions options;
  options.precision = arguments.precision == "f32"    ? inference::Precision::kF32
                      : arguments.precision == "bf16" ? inference::Precision::kBf16
                                                      : inference::Precision::kAuto;
  if (IsModelFolder(arguments.model)) {
    return inference::ActionModel::Load(arguments.model, options);
  }
  client::Client& server = environment.server_client();  // may end the program: before the folder
  const ScratchFolder scratch;
  if (scratch.path().empty()) {
    return absl::FailedPreconditionError(
        "no folder for the model could be made in the folder for temporary files; set TMPDIR");
  }
  const std::string folder = (scratch.path() / "model").string();
  TransferLine line(environment);
  client::CallOptions call = environment.call_options();
  call.cancellation = &cancellation;
  const auto version =
      server.DownloadModelVersion(ModelResource(arguments.model), folder, line.callback(), call);
  line.Clear();
  if (!version.ok()) return version.status();
  environment.err << "the model is " << ShortName(*version) << "\n";
  return inference::ActionModel::Load(folder, options);
}

// Parses "i/n".
bool ParseShards(const std::string& text, tags::TaggingOptions* options) {
  const std::vector<std::string> parts = absl::StrSplit(text, '/');
  return parts.size() == 2 && absl::SimpleAtoi(parts[0], &options->part) &&
         absl::SimpleAtoi(parts[1], &options->parts) && options->part >= 0 &&
         options->part < options->parts;
}

int RefuseShards(const TagArguments& arguments, Environment& environment) {
  return environment.Refuse(absl::StrCat("--shards ", arguments.shards,
                                         ": give i/n, such as 0/8 to 7/8; parts are counted from "
                                         "0"));
}

void PrintSummary(const TagArguments& arguments, const tags::TaggingSummary& summary,
                  double seconds, Environment& environment) {
  const double rate = static_cast<double>(summary.windows) / std::max(seconds, 1e-3);
  if (environment.json()) {
    google::protobuf::Struct printed;
    const auto set = [&printed](const std::string& name, double value) {
      (*printed.mutable_fields())[name].set_number_value(value);
    };
    (*printed.mutable_fields())["folder"].set_string_value(arguments.output);
    set("shards", static_cast<double>(summary.shards));
    set("shardsBefore", static_cast<double>(summary.shards_before));
    set("shardsFailed", static_cast<double>(summary.failures.size()));
    set("recordings", static_cast<double>(summary.recordings));
    set("windows", static_cast<double>(summary.windows));
    set("rows", static_cast<double>(summary.rows));
    set("seconds", seconds);
    set("windowsPerSecond", rate);
    environment.PrintJson(printed);
    return;
  }
  environment.out << arguments.output << ": " << HowMany(summary.windows, "window") << " of "
                  << HowMany(summary.recordings, "recording") << " in "
                  << HowMany(summary.rows, "row") << ", " << HowMany(summary.shards, "shard");
  if (summary.shards_before > 0) {
    environment.out << "; " << summary.shards_before << " were there";
  }
  environment.out << "\n";
  if (summary.windows > 0) {
    environment.err << Fixed(rate, 0) << " windows a second, " << Spell(seconds) << "\n";
  }
}

int Tag(const TagArguments& arguments, Environment& environment) {
  tags::TaggingOptions options;
  if (!ParseShards(arguments.shards, &options)) return RefuseShards(arguments, environment);
  client::Cancellation cancellation;
  const Interrupt interrupt([&cancellation] { cancellation.Cancel(); });
  const auto model = LoadModel(arguments, cancellation, environment);
  if (interrupt.happened()) return environment.Fail(absl::CancelledError("interrupted"));
  if (!model.ok()) {
    return IsModelFolder(arguments.model) ? environment.FailAt(arguments.model, model.status())
                                          : environment.FailCall(model.status());
  }
  options.datasets.assign(arguments.datasets.begin(), arguments.datasets.end());
  options.output = arguments.output;
  options.merged = !arguments.windows;
  options.stride = arguments.stride;
  options.threads =
      arguments.threads > 0 ? static_cast<int>(arguments.threads) : machine::UsableCores();
  ProgressLine progress(environment.errors, environment.progress_form());
  const auto start = std::chrono::steady_clock::now();
  const auto passed = [start] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  options.progress = [&](const tags::TaggingProgress& now) {
    progress.Show(
        static_cast<double>(now.recordings) /
            static_cast<double>(std::max<int64_t>(1, now.all_recordings)),
        absl::StrCat(now.recordings, " of ", now.all_recordings, " recordings, ", now.shards,
                     " shards, ",
                     Fixed(static_cast<double>(now.windows) / std::max(passed(), 1e-3), 0),
                     " windows a second"));
    return !interrupt.happened();
  };
  const auto summary = tags::TagDatasets(*model, options);
  progress.Clear();
  if (!summary.ok()) return environment.Fail(summary.status());
  PrintSummary(arguments, *summary, passed(), environment);
  for (const absl::Status& failure : summary->failures) environment.Fail(failure);
  return summary->failures.empty() ? kOk : kFailed;
}

// Starts a job that tags the server's datasets.
int TagOnServer(const TagArguments& arguments, Environment& environment) {
  tags::TaggingOptions shards;
  if (!ParseShards(arguments.shards, &shards)) return RefuseShards(arguments, environment);
  v1::TagRequest request;
  request.set_model(ModelResource(arguments.model));
  for (const std::string& name : arguments.datasets) request.add_datasets(DatasetResource(name));
  request.set_tags(TagsResource(arguments.on_server));
  request.set_part(shards.part);
  request.set_parts(shards.parts);
  request.set_windows(arguments.windows);
  if (arguments.stride) {
    const auto nanos = static_cast<int64_t>(std::llround(*arguments.stride * 1e9));
    request.mutable_stride()->set_seconds(nanos / 1'000'000'000);
    request.mutable_stride()->set_nanos(static_cast<int32_t>(nanos % 1'000'000'000));
  }
  request.set_priority(static_cast<int32_t>(arguments.priority.value_or(0)));
  request.set_validate_only(arguments.validate_only);
  const auto job = environment.server_client().Tag(request, environment.call_options());
  if (!job.ok()) return environment.FailCall(job.status());
  if (arguments.validate_only) {
    PrintValid(*job, environment);
    return kOk;
  }
  return ShowStarted(*job, "tags", arguments.detach, environment);
}

}  // namespace

void AddTag(Command& root, Environment& environment) {
  const auto arguments = std::make_shared<TagArguments>();
  Command command = root.Add(
      "tag", "Tag each target of datasets with its actions",
      "For each target and time: which action it took, q(y|x,s), and how likely the model found "
      "it, "
      "p(y|s).\n"
      "Works in this process on all cores. The folder gets, for each shard of the datasets, a "
      "gzipped CSV\n"
      "file for other programs and a file that maneuver find reads. To continue an interrupted "
      "run, use the same\ncommand. The same command always writes the same bytes.\n"
      "With --on-server, a job of the server does the same with the server's datasets. maneuver "
      "tags "
      "pull brings\nwhat it made.\n"
      "Example: maneuver tag town --model town/3 -o tags\n"
      "         maneuver tag town --model town-3 -o tags --shards $SLURM_ARRAY_TASK_ID/16\n"
      "         maneuver tag town --model town/3 --on-server june --detach");
  command.Arguments("DATASET", &arguments->datasets,
                    "Dataset folders; with --on-server, datasets of the server");
  command.Option("--model", &arguments->model,
                 "A model folder; or town (what serves), town/3 or town@candidate of the server");
  command.Option("-o,--out", &arguments->output, "Folder for the tags; made if it is missing");
  command.Option("--shards", &arguments->shards,
                 "i/n: tag the i-th of n parts of the shards, counted from 0");
  command.Flag("--windows", &arguments->windows,
               "Write a row for each window, even if consecutive windows have the same action");
  command.Option("--stride", &arguments->stride, 0.01, 3600.0,
                 "Seconds between two windows of a target [as in the model's training]");
  command.Choice("--precision", &arguments->precision, {"f32", "bf16", "auto"},
                 "f32 gives the same tags on any processor of one kind; auto is bf16 where the "
                 "processor has it");
  command.Option("--threads", &arguments->threads, 0, 1024, "Threads; 0: one for each core");
  command.Option("--on-server", &arguments->on_server,
                 "Start a job on the server, whose tags get this name: a-z, 0-9 and -");
  command.Option("--priority", &arguments->priority, -100, 100,
                 "Jobs with a higher priority run first [0]");
  command.Flag("--detach", &arguments->detach, "Start the job and return");
  command.Flag("--validate-only", &arguments->validate_only, "Check the request, start nothing");
  for (const char* here : {"--out", "--precision", "--threads"}) {
    command.Exclude(here, "--on-server");
  }
  for (const char* there : {"--priority", "--detach", "--validate-only"}) {
    command.Need(there, "--on-server");
  }
  command.Run([arguments, &environment] {
    if (!arguments->on_server.empty()) return TagOnServer(*arguments, environment);
    if (arguments->model.empty()) return environment.Refuse("--model: name a folder or a model");
    if (arguments->output.empty()) return environment.Refuse("--out: name a folder for the tags");
    return Tag(*arguments, environment);
  });
}

}  // namespace maneuver::cli
