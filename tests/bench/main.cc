// maneuver-bench: measures the parts of an answer.

#include <benchmark/benchmark.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <iostream>
#include <iterator>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "git_revision.h"
#include "model/kernels/kernel_choice.h"
#include "tests/bench/answer_digest.h"
#include "tests/bench/bench_model.h"
#include "tests/bench/bench_report.h"
#include "tests/bench/bench_scenes.h"
#include "tests/bench/turns.h"

namespace maneuver::bench {
namespace {

constexpr int kScenes = 12;

struct Arguments {
  std::string report;
  std::string turns;
  std::string write_model;
  std::string pictures;
  std::string model = "compact";
  std::string dataset;
  bool digest = false;
  bool f32 = false;
  std::string kernels = "auto";
  double seconds = 10.0;
};

int Fail(const absl::Status& status) {
  std::cerr << "maneuver-bench: " << status << "\n";
  return EXIT_FAILURE;
}

// Returns up to `most` recorded scenes with kLargestBatch targets each; none if there are no recordings.
absl::StatusOr<std::vector<v1::Scenario>> RecordedScenes(const Arguments& arguments,
                                                         int most = kScenes) {
  if (arguments.dataset.empty()) return WaymoScenes(kLargestBatch, most);
  return DatasetScenes(arguments.dataset, kLargestBatch, most);
}

absl::StatusOr<BenchModel> Model(const std::string& name) {
  for (const char* preset : kPresets) {
    if (name == preset) return PresetBenchModel(preset);
  }
  return FolderBenchModel(name);
}

int WriteModel(const Arguments& arguments) {
  const auto model = Model(arguments.model);
  if (!model.ok()) return Fail(model.status());
  const absl::Status status = artifact::WriteModelFolder(arguments.write_model, *model->stored);
  return status.ok() ? EXIT_SUCCESS : Fail(status);
}

int Turns(const Arguments& arguments) {
  auto model = Model(arguments.model);
  if (!model.ok()) return Fail(model.status());
  auto scenes = RecordedScenes(arguments);
  if (!scenes.ok()) return Fail(scenes.status());
  if (scenes->empty()) *scenes = TownScenes(kLargestBatch, 1);
  if (arguments.f32) *model = WithPrecision(*model, inference::Precision::kF32);
  const absl::Status status = TakeTurns(*model, *scenes, arguments.turns, std::cin, std::cout);
  return status.ok() ? EXIT_SUCCESS : Fail(status);
}

int Digest(const Arguments& arguments) {
  auto model = Model(arguments.model);
  if (!model.ok()) return Fail(model.status());
  if (arguments.f32) *model = WithPrecision(*model, inference::Precision::kF32);
  constexpr int kAll = std::numeric_limits<int>::max();
  auto scenes = RecordedScenes(arguments, kAll);
  if (!scenes.ok()) return Fail(scenes.status());
  const size_t recorded = scenes->size();
  std::ranges::move(TownScenes(kLargestBatch, kScenes), std::back_inserter(*scenes));
  std::cout << AnswerDigest(*model, *scenes) << "  answers in " << model->model->precision()
            << " for " << recorded << " recorded and " << scenes->size() - recorded
            << " synthetic scenes\n";
  return EXIT_SUCCESS;
}

int Report(const Arguments& arguments) {
  ReportOptions options;
  options.file = std::filesystem::absolute(arguments.report);
  options.pictures = arguments.pictures.empty() ? options.file.parent_path()
                                                : std::filesystem::absolute(arguments.pictures);
  options.seconds = arguments.seconds;
#ifdef MANEUVER_TRAINER
  options.libtorch = LibTorchEncode;
#endif
  auto model = Model(arguments.model);
  if (!model.ok()) return Fail(model.status());
  options.models.push_back(*std::move(model));
  for (const char* preset : kPresets) {
    if (preset != arguments.model) options.models.push_back(PresetBenchModel(preset));
  }
  auto recorded = RecordedScenes(arguments);
  if (!recorded.ok()) return Fail(recorded.status());
  if (!recorded->empty()) options.scenes.push_back({"recorded scenes", *std::move(recorded)});
  options.scenes.push_back({"synthetic scenes", TownScenes(kLargestBatch, kScenes)});
  const absl::Status status = WriteReport(options);
  return status.ok() ? EXIT_SUCCESS : Fail(status);
}

// Runs the benchmarks with options of google-benchmark.
int Benchmarks(char* program, std::vector<std::string> options) {
  std::vector<char*> arguments = {program};
  for (std::string& option : options) arguments.push_back(option.data());
  auto count = static_cast<int>(arguments.size());
  arguments.push_back(nullptr);
  benchmark::Initialize(&count, arguments.data());
  if (benchmark::ReportUnrecognizedArguments(count, arguments.data())) return EXIT_FAILURE;
  RegisterEngineBenchmarks();
  RegisterLanePathBenchmarks();
  RegisterMapBenchmarks();
  RegisterStageBenchmarks();
#ifdef MANEUVER_TRAINER
  RegisterLibTorchBenchmarks();
#endif
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return EXIT_SUCCESS;
}

int Main(int argc, char** argv) {
  CLI::App app(
      "What the parts of an answer cost, by google-benchmark (--benchmark_filter=stages, "
      "--benchmark_list_tests), or as a report in which everything is measured in turn.");
  app.allow_extras();
  app.set_version_flag("--version", kGitRevision, "The commit that it was built from");
  Arguments arguments;
  app.add_option("--report", arguments.report, "Markdown file to write, in place of benchmarks");
  app.add_option("--pictures", arguments.pictures,
                 "Folder of the report's pictures [the report's own]");
  app.add_option("--model", arguments.model,
                 "Folder of the model to look at most closely, or a preset: random weights")
      ->capture_default_str();
  app.add_option("--dataset", arguments.dataset,
                 "Dataset folder with recorded scenes [those of MANEUVER_REAL_DATA]");
  app.add_option("--seconds", arguments.seconds, "Length of each of the report's measurements")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option(
      "--turns", arguments.turns,
      "File for the inputs of another engine; then evaluates when standard input says so "
      "(tests/bench/peers)");
  app.add_flag("--digest", arguments.digest,
               "Prints the SHA-256 of the answers for all recorded scenes and some synthetic ones, "
               "in place of benchmarks");
  app.add_flag("--f32", arguments.f32,
               "Computes turns and digest in f32, also where the processor has bf16");
  app.add_option("--kernels", arguments.kernels,
                 "Vector code; auto: the processor's best; plain: none")
      ->check(CLI::IsMember({"auto", "plain"}))
      ->capture_default_str();
  app.add_option("--write-model", arguments.write_model,
                 "Folder to write the model to, for what else is to measure a preset");
  CLI11_PARSE(app, argc, argv);
  kernels::ChooseKernels(arguments.kernels == "plain" ? kernels::KernelChoice::kPlain
                                                      : kernels::KernelChoice::kAuto);
  const bool benchmarks = arguments.write_model.empty() && arguments.turns.empty() &&
                          arguments.report.empty() && !arguments.digest;
  if (benchmarks) return Benchmarks(argv[0], app.remaining());
  if (const auto others = app.remaining(); !others.empty()) {
    std::cerr << "maneuver-bench: " << others.front() << " is not an option here; see --help\n";
    return EXIT_FAILURE;
  }
  if (!arguments.write_model.empty()) return WriteModel(arguments);
  if (!arguments.turns.empty()) return Turns(arguments);
  if (arguments.digest) return Digest(arguments);
  return Report(arguments);
}

}  // namespace
}  // namespace maneuver::bench

int main(int argc, char** argv) { return maneuver::bench::Main(argc, argv); }
