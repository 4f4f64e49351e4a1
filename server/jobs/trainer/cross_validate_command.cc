#include "server/jobs/trainer/cross_validate_command.h"

#include <unistd.h>

#include <algorithm>
#include <iostream>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "maneuver/v1/training_service.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/artifact/training_presets.h"
#include "model/evaluation/cross_validation_parts.h"
#include "model/evaluation/cross_validation_report.h"
#include "model/evaluation/cross_validation_text.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "server/jobs/trainer/data_memory_option.h"
#include "server/jobs/trainer/dataset_names.h"
#include "server/jobs/trainer/fold_files.h"
#include "server/jobs/trainer/named_folders.h"
#include "server/jobs/trainer/number_checks.h"
#include "server/jobs/trainer/progress_display.h"
#include "server/jobs/trainer/settings_file.h"
#include "server/jobs/trainer/stop_signal.h"

namespace maneuver::trainer {
namespace {

constexpr char kFooter[] =
    R"(Every recording is measured by a model that learned from no recording that
shares its place or its agents. The table has means over all examples, with
95 % intervals, and says where the model is ahead of other predictors.
docs/guides/cross-validation.md explains it. For example:

  maneuver-trainer cross-validate --dataset city --folds 5 --seeds 1,2,3 \
      --baselines --test-dataset ngsim=ngsim --output city.json

The same with each fold in a process of its own, side by side or on different
machines:

  maneuver-trainer cross-validate --dataset city --only-fold 1 --part 1.part
  ...
  maneuver-trainer cross-validate --dataset city --only-fold 5 --part 5.part
  maneuver-trainer cross-validate --merge 1.part 2.part 3.part 4.part 5.part \
      --output city.json)";

// A folder of models that is removed with this, unless its owner named it.
class ModelsFolder {
 public:
  static absl::StatusOr<ModelsFolder> Make(const std::filesystem::path& named) {
    std::error_code error;
    const bool temporary = named.empty();
    const std::filesystem::path path = temporary
                                           ? std::filesystem::temp_directory_path(error) /
                                                 absl::StrCat("maneuver-cross-validate-", getpid())
                                           : named;
    if (!error) std::filesystem::create_directories(path, error);
    if (error) return files::ErrnoStatus(error.value(), "create", path);
    return ModelsFolder(path, temporary);
  }
  ModelsFolder(ModelsFolder&& other) noexcept
      : path_(std::exchange(other.path_, {})), temporary_(other.temporary_) {}
  ModelsFolder& operator=(ModelsFolder&&) = delete;
  ~ModelsFolder() {
    std::error_code ignored;
    if (temporary_ && !path_.empty()) std::filesystem::remove_all(path_, ignored);
  }

  const std::filesystem::path& path() const { return path_; }

 private:
  ModelsFolder(std::filesystem::path path, bool temporary)
      : path_(std::move(path)), temporary_(temporary) {}

  std::filesystem::path path_;
  bool temporary_;
};

absl::StatusOr<learning::NamedDataset> ParseTestDataset(const std::string& text) {
  const size_t equals = text.find('=');
  if (equals == 0 || equals == text.npos || equals + 1 == text.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("--test-dataset ", text, ": say NAME=FOLDER, as in ngsim=data/ngsim"));
  }
  return learning::NamedDataset{text.substr(0, equals), text.substr(equals + 1)};
}

std::string FoldName(const learning::CrossValidation& run, int64_t seed, int fold) {
  return absl::StrCat("seed ", seed, ", fold ", fold + 1, " of ", run.folds);
}

// "285 recordings in 281 groups, 2 in the largest; folds of 57, 57, 57, 57, 57 recordings"
std::string DescribePlan(const v1::CrossValidationPlan& plan) {
  std::map<int, int> groups;
  std::vector<int> folds(static_cast<size_t>(plan.folds()));
  int largest = 0;
  for (const v1::GroupedRecording& recording : plan.recordings()) {
    largest = std::max(largest, ++groups[recording.group()]);
    ++folds[static_cast<size_t>(recording.fold())];
  }
  std::string text = absl::StrCat(plan.recordings_size(), " recordings in ", groups.size(),
                                  " groups, ", largest, " in the largest; folds of ");
  for (size_t i = 0; i < folds.size(); ++i) absl::StrAppend(&text, i > 0 ? ", " : "", folds[i]);
  absl::StrAppend(&text, " recordings\n");
  for (const v1::TestDataset& test : plan.test_datasets()) {
    absl::StrAppend(&text, "test dataset ", test.name(), ": ", test.recordings_size(),
                    " recordings, ", test.left_out(), " left out\n");
  }
  return text;
}

double MeanOf(const v1::MeasuredSet& set, const std::string& name) {
  const auto found = std::find(set.value_names().begin(), set.value_names().end(), name);
  const auto index = static_cast<int>(found - set.value_names().begin());
  double sum = 0.0;
  for (const v1::MeasuredExample& example : set.examples()) sum += example.values(index);
  return sum / set.examples_size();
}

std::string DescribeSet(const v1::MeasuredSet& set) {
  const double ade = MeanOf(set, "ade_1");
  return absl::StrFormat(
      "%d examples, ade_1 %.2f m (%.3f of constant velocity's), min_ade_6 %.2f m",
      set.examples_size(), ade, ade / MeanOf(set, "ade_cv"), MeanOf(set, "min_ade_6"));
}

// Shows a whole cross-validation: for people a bar for each training and a line for each fold, for
// programs the progress of the whole.
class FoldDisplay {
 public:
  FoldDisplay(const learning::CrossValidation& run, ProgressDisplay::Style style)
      : run_(run),
        style_(style),
        models_((run.only_fold ? 1 : run.folds) * static_cast<int>(run.seeds.size())),
        done_(static_cast<int>(run.finished.size())) {}

  void Begin(int64_t seed, int fold) {
    if (style_ == ProgressDisplay::Style::kBar) {
      std::cout << FoldName(run_, seed, fold) << std::endl;
    }
    display_.emplace(style_, std::cout);
  }

  void Show(v1::JobProgress progress) {
    if (style_ == ProgressDisplay::Style::kJson) {
      progress.set_fraction((done_ + progress.fraction()) / models_);
      progress.clear_time_left();
    }
    display_->Show(progress);
  }

  void Finish(const v1::FoldRun& result) {
    display_.reset();
    ++done_;
    if (style_ != ProgressDisplay::Style::kBar) return;
    std::cout << FoldName(run_, result.seed(), result.fold()) << ": learned from "
              << result.learned_size() << " recordings; " << DescribeSet(result.held_out()) << "\n";
    for (int i = 0; i < result.tests_size(); ++i) {
      std::cout << "  " << run_.test_datasets[static_cast<size_t>(i)].name << ": "
                << DescribeSet(result.tests(i)) << "\n";
    }
    std::cout << std::flush;
  }

 private:
  const learning::CrossValidation& run_;
  const ProgressDisplay::Style style_;
  const int models_;
  int done_;
  std::optional<ProgressDisplay> display_;
};

absl::Status CheckDistinct(const std::vector<int64_t>& seeds) {
  if (std::set<int64_t>(seeds.begin(), seeds.end()).size() == seeds.size()) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError("--seeds: name each seed once");
}

}  // namespace

CrossValidateCommand::CrossValidateCommand(CLI::App& app)
    : command_(app.add_subcommand(
          "cross-validate",
          "Measure settings on whole datasets, each recording by a model that did not learn from "
          "it or its neighbours")) {
  command_->footer(kFooter);
  command_
      ->add_option("--settings", settings_,
                   "TrainingSettings as JSON; without it, the preset lanes")
      ->type_name("FILE");
  command_->add_option("--dataset", datasets_, "Dataset folders to learn from and to measure")
      ->type_name("FOLDER");
  command_
      ->add_option("--dataset-name", dataset_names_,
                   "Names of the datasets for the report (default: the folders')")
      ->type_name("NAME");
  command_
      ->add_option("--test-dataset", test_datasets_,
                   "Also measure every model on this dataset; none learns from it; may be "
                   "repeated")
      ->type_name("NAME=FOLDER");
  command_->add_option("--folds", folds_, "Number of folds to divide the recordings into")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str()
      ->type_name("N");
  command_->add_option("--fold-seed", fold_seed_, "Seed of the division into folds")
      ->check(FitsInt64())
      ->capture_default_str()
      ->type_name("N");
  command_
      ->add_option(
          "--seeds", seeds_,
          "Training seeds, such as 1,2,3: every fold is trained once with each; default: the "
          "seed of the settings")
      ->delimiter(',')
      ->check(FitsInt64())
      ->type_name("N,...");
  command_
      ->add_option("--only-fold", only_fold_,
                   "Train and measure this fold alone, counted from 1; needs --part")
      ->check(CLI::PositiveNumber)
      ->type_name("I");
  command_->add_flag("--baselines", baselines_,
                     "Train a CoverNet-like and a MultiPath-like baseline in each fold too; takes "
                     "about as long again");
  command_->add_flag("--plan-only", plan_only_,
                     "Print how the recordings are grouped and divided, and exit");
  command_
      ->add_option("--models", models_,
                   "Keep the models in this folder, as seed-1-fold-1 and so on; without it they "
                   "are removed")
      ->type_name("FOLDER");
  command_
      ->add_option("--checkpoints", checkpoints_,
                   "Keep what each model measured in this folder; a run that finds its own there "
                   "goes on with the models that are missing")
      ->type_name("FOLDER");
  command_
      ->add_option("--part", part_,
                   "Also write what was measured on each example, for --merge (a "
                   "CrossValidationPart in binary)")
      ->type_name("FILE");
  command_->add_option("--merge", merge_, "Train nothing; report on these files of --part together")
      ->type_name("FILE")
      ->excludes("--dataset");
  command_->add_option("--output", output_, "CrossValidationReport as JSON")->type_name("FILE");
  command_->add_option("--resamples", resamples_, "Draws of the bootstrap for the intervals")
      ->check(CLI::Range(100, 100'000))
      ->capture_default_str()
      ->type_name("N");
  AddDataMemoryOption(*command_, &data_memory_);
  command_->add_option("--threads", threads_, "Threads; 0: the settings', or one for each core")
      ->check(CLI::Range(0, 1024))
      ->type_name("N");
  command_
      ->add_option("--progress", progress_,
                   "bar for people, json for programs (a JobProgress a line), or none")
      ->check(CLI::IsMember({"json", "bar", "none"}))
      ->capture_default_str();
}

int CrossValidateCommand::Run() const { return ExitStatus(CrossValidate()); }

absl::Status CrossValidateCommand::CrossValidate() const {
  if (merge_.empty() == datasets_.empty()) {
    return absl::InvalidArgumentError("say either --dataset or --merge");
  }
  if (plan_only_) {
    const absl::StatusOr<learning::CrossValidation> run = Prepare();
    if (!run.ok()) return run.status();
    const absl::StatusOr<v1::CrossValidationPlan> plan = learning::PlanCrossValidation(*run);
    if (plan.ok()) std::cout << DescribePlan(*plan);
    return plan.status();
  }
  if (!merge_.empty()) {
    absl::StatusOr<std::vector<v1::CrossValidationPart>> parts = ReadParts();
    return parts.ok() ? Report(*std::move(parts)) : parts.status();
  }
  absl::StatusOr<v1::CrossValidationPart> part = Measure();
  // One fold alone is no cross-validation yet.
  if (!part.ok() || only_fold_ > 0) return part.status();
  std::vector<v1::CrossValidationPart> parts;
  parts.push_back(*std::move(part));
  return Report(std::move(parts));
}

absl::StatusOr<learning::CrossValidation> CrossValidateCommand::Prepare() const {
  learning::CrossValidation run;
  v1::TrainingSettings settings;
  if (!settings_.empty()) {
    if (absl::Status status = ReadJson(settings_, &settings); !status.ok()) return status;
  }
  run.settings = artifact::ResolveTrainingSettings(settings);
  if (threads_ > 0) run.settings.set_threads(threads_);
  const auto violations = artifact::ValidateTrainingSettings(run.settings);
  if (!violations.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("settings: ", violations.front().field, " ", violations.front().description));
  }
  if (absl::Status status = CheckDatasets(datasets_); !status.ok()) return status;
  run.datasets = datasets_;
  absl::StatusOr<std::vector<std::string>> names = DatasetNames(dataset_names_, datasets_);
  if (!names.ok()) return names.status();
  run.dataset_names = *std::move(names);
  for (const std::string& text : test_datasets_) {
    absl::StatusOr<learning::NamedDataset> test = ParseTestDataset(text);
    if (!test.ok()) return test.status();
    run.test_datasets.push_back(*std::move(test));
  }
  run.folds = folds_;
  run.fold_seed = fold_seed_;
  run.seeds = seeds_.empty() ? std::vector<int64_t>{run.settings.seed()} : seeds_;
  if (absl::Status status = CheckDistinct(run.seeds); !status.ok()) return status;
  if (only_fold_ > folds_) {
    return absl::InvalidArgumentError(
        absl::StrCat("--only-fold ", only_fold_, ": there are ", folds_, " folds, counted from 1"));
  }
  if (only_fold_ > 0 && part_.empty()) {
    return absl::InvalidArgumentError("--only-fold needs --part FILE for what it measures");
  }
  if (only_fold_ > 0) run.only_fold = only_fold_ - 1;
  run.data_memory = data_memory_;
  run.baselines = baselines_ || run.settings.baselines();
  run.trainer_version = MANEUVER_VERSION;
  run.stopped = StopRequested;
  return run;
}

absl::StatusOr<v1::CrossValidationPart> CrossValidateCommand::Measure() const {
  absl::StatusOr<learning::CrossValidation> run = Prepare();
  if (!run.ok()) return run.status();
  const ProgressDisplay::Style style = ProgressDisplay::ParseStyle(progress_);
  if (style == ProgressDisplay::Style::kJson && output_.empty() && part_.empty()) {
    return absl::InvalidArgumentError(
        "with --progress json standard output is for programs; say with --output where the report "
        "shall go");
  }
  for (const std::filesystem::path& output : {output_, part_}) {
    if (output.empty()) continue;
    if (absl::Status status = PrepareOutput(output); !status.ok()) return status;
  }
  const absl::StatusOr<ModelsFolder> models = ModelsFolder::Make(models_);
  if (!models.ok()) return models.status();
  run->models = models->path();
  const absl::StatusOr<v1::CrossValidationPlan> plan = learning::PlanCrossValidation(*run);
  if (!plan.ok()) return plan.status();
  if (style == ProgressDisplay::Style::kBar) std::cout << DescribePlan(*plan) << std::endl;
  std::optional<FoldFiles> kept;
  if (!checkpoints_.empty()) {
    absl::StatusOr<FoldFiles> opened = FoldFiles::Open(checkpoints_, *plan);
    if (!opened.ok()) return opened.status();
    kept = *std::move(opened);
    for (const v1::FoldRun& each : kept->runs()) run->finished.insert({each.seed(), each.fold()});
  }
  absl::Status keeping;  // the first that could not be kept
  FoldDisplay display(*run, style);
  run->began = [&](int64_t seed, int fold) { display.Begin(seed, fold); };
  run->progress = [&](const v1::JobProgress& progress) { display.Show(progress); };
  run->measured = [&](const v1::FoldRun& result) {
    display.Finish(result);
    if (kept) keeping.Update(kept->Add(result));
  };
  run->stopped = [&keeping] { return !keeping.ok() || StopRequested(); };
  absl::StatusOr<v1::CrossValidationPart> part = learning::CrossValidate(*run, *plan);
  if (!keeping.ok()) return keeping;
  if (part.ok() && kept) {
    for (const v1::FoldRun& each : kept->runs()) *part->add_runs() = each;
  }
  if (part.ok() && !part_.empty()) {
    absl::Status status = files::WriteFileAtomically(part_, part->SerializeAsString());
    if (!status.ok()) return status;
  }
  return part;
}

absl::StatusOr<std::vector<v1::CrossValidationPart>> CrossValidateCommand::ReadParts() const {
  std::vector<v1::CrossValidationPart> parts;
  for (const std::filesystem::path& file : merge_) {
    const absl::StatusOr<std::string> bytes = files::ReadInput(file);
    if (!bytes.ok()) {
      return absl::InvalidArgumentError(
          absl::StrCat(file.filename().string(), ": ", std::string(bytes.status().message())));
    }
    if (!parts.emplace_back().ParseFromString(*bytes)) {
      return absl::DataLossError(
          absl::StrCat(file.filename().string(), " is not a file of cross-validate --part"));
    }
  }
  return parts;
}

absl::Status CrossValidateCommand::Report(std::vector<v1::CrossValidationPart> parts) const {
  const absl::StatusOr<v1::CrossValidationPart> whole = evaluation::MergeParts(std::move(parts));
  if (!whole.ok()) return whole.status();
  const v1::CrossValidationReport report =
      evaluation::MakeCrossValidationReport(*whole, {.resamples = resamples_});
  if (ProgressDisplay::ParseStyle(progress_) != ProgressDisplay::Style::kJson || !merge_.empty()) {
    std::cout << "\n" << evaluation::CrossValidationText(report, PrintsBold());
  }
  return output_.empty() ? absl::OkStatus() : WriteJson(output_, report);
}

}  // namespace maneuver::trainer
