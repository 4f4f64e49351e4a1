#include "tests/bench/bench_report.h"

#include <fstream>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "git_revision.h"
#include "model/artifact/backbone_layers.h"
#include "model/artifact/model_cost.h"
#include "model/inference/backbone.h"
#include "model/machine/usable_cores.h"
#include "tests/bench/bench_scenes.h"
#include "tests/bench/curves.h"
#include "tests/bench/markdown.h"
#include "tests/bench/precision_change.h"
#include "tests/bench/stage_times.h"
#include "tests/bench/worker_scaling.h"
#include "tests/bench/yardsticks.h"

namespace maneuver::bench {
namespace {

constexpr size_t kScenesOfAKind = 6;

// The times of the three yardsticks, measured in the same rounds as everything else.
class YardstickTimes {
 public:
  explicit YardstickTimes(size_t bytes) : yardsticks_(bytes) {}

  void Add(std::vector<std::function<void()>>* things) {
    things->push_back([this] { yardsticks_.MultiplyF32(); });
    things->push_back([this] { yardsticks_.Read(); });
    things->push_back([this] { yardsticks_.Copy(); });
    if (has_bf16_) things->push_back([this] { yardsticks_.MultiplyBf16(); });
  }
  void Take(std::span<const Series>* series) {
    f32_ = (*series)[0];
    read_ = (*series)[1];
    copy_ = (*series)[2];
    if (has_bf16_) bf16_ = (*series)[3];
    *series = series->subspan(has_bf16_ ? 4 : 3);
  }

  // Returns the share of the peak that an evaluation reaches: `operations` in the seconds of each
  // round.
  std::string ShareOfPeak(double operations, const Series& seconds, bool bf16) const {
    const double scale = operations / Yardsticks::operations();
    return Percent(scale * Median(Ratios(bf16 ? bf16_ : f32_, seconds)));
  }

  std::string Table() const {
    const auto giga = [](double count, const Series& seconds) {
      return Short(count / Median(seconds) / 1e9);
    };
    std::string table = Header({"yardstick, one core", "", "unit"});
    table += Row({"matrix product, f32", giga(Yardsticks::operations(), f32_), "GFLOP/s"});
    table += Row({"matrix product, bf16",
                  has_bf16_ ? giga(Yardsticks::operations(), bf16_) : "not on this processor",
                  "GFLOP/s"});
    table += Row({"memory, read", giga(yardsticks_.bytes(), read_), "GB/s"});
    table += Row(
        {"memory, copied", giga(yardsticks_.bytes(), copy_), "GB/s, each byte read and written"});
    return table;
  }

 private:
  Yardsticks yardsticks_;
  const bool has_bf16_ = inference::ProcessorHasBf16();
  Series f32_, bf16_, read_, copy_;
};

// The content of one request, or of several that form a batch.
struct Workload {
  std::string name;
  Pipelines pipelines;
  StageTimes times;
};

std::vector<Workload> MakeWorkloads(const BenchModel& model, const std::vector<SceneSet>& sets) {
  std::vector<Workload> workloads;
  for (const SceneSet& set : sets) {
    Workload together{absl::StrCat(set.name, ", 8 targets of one scene"), {}, {}};
    std::vector<v1::PredictRequest> singles;
    for (size_t i = 0; i < static_cast<size_t>(kLargestBatch); ++i) {
      v1::Scenario scene = set.scenes[i % set.scenes.size()];
      if (i < std::min(kScenesOfAKind, set.scenes.size())) {
        together.pipelines.push_back(std::make_unique<Pipeline>(
            model, std::vector{RequestFor({scene}, kDescribedActions)}, kDescribedActions));
      }
      scene.mutable_target_ids()->Truncate(1);
      singles.push_back(RequestFor({scene}, kDescribedActions));
    }
    workloads.push_back(std::move(together));
    Workload alone{absl::StrCat(set.name, ", 8 requests of one target"), {}, {}};
    alone.pipelines.push_back(std::make_unique<Pipeline>(model, singles, kDescribedActions));
    workloads.push_back(std::move(alone));
  }
  return workloads;
}

std::string StageTable(const v1::ModelSpec& spec, const std::vector<Workload>& workloads) {
  std::vector<std::string> head = {"microseconds a target"};
  for (const Workload& workload : workloads) {
    head.push_back(workload.name);
    head.push_back("share");
  }
  std::string table = Header(head);
  const auto row = [&](const std::string& name, const auto& of) {
    std::vector<std::string> cells = {name};
    for (const Workload& workload : workloads) {
      const Series& series = of(workload.times);
      cells.push_back(Microseconds(series));
      cells.push_back(Percent(Median(Ratios(series, workload.times.AllStages()))));
    }
    table += Row(cells);
  };
  for (int i = 0; i < kStages; ++i) {
    const Stage stage = static_cast<Stage>(i);
    row(StageName(stage, spec), [&](const StageTimes& times) { return times.Of(stage); });
    if (stage != Stage::kDistributions) continue;
    row("... scenario encoders", [](const StageTimes& times) { return times.scenario_encoders; });
    row("... decoder", [](const StageTimes& times) { return times.decoder; });
  }
  row("sum of the stages", [](const StageTimes& times) { return times.AllStages(); });
  row("whole answer", [](const StageTimes& times) { return times.together; });
  return table;
}

std::string StagePicture(const std::string& title, const v1::ModelSpec& spec,
                         const std::vector<Workload>& workloads) {
  std::vector<std::string> bars, parts;
  for (const Workload& workload : workloads) bars.push_back(workload.name);
  std::vector<std::vector<double>> values;
  for (int i = 0; i < kStages; ++i) {
    parts.push_back(StageName(static_cast<Stage>(i), spec));
    std::vector<double>& row = values.emplace_back();
    for (const Workload& workload : workloads) {
      row.push_back(kMicroseconds * Median(workload.times.Of(static_cast<Stage>(i))));
    }
  }
  return DrawBars(title, "microseconds a target", bars, parts, values);
}

std::string RatioTable(const v1::ModelSpec& spec, const std::vector<Workload>& workloads) {
  const bool raster = spec.has_raster() && !spec.has_scene_vectors();
  std::string table = Header({"ratio, median (middle half of the rounds)", "measured", "target"});
  for (const Workload& workload : workloads) {
    const StageTimes& times = workload.times;
    const auto row = [&](const std::string& what, const Series& a, const Series& b,
                         const char* target) {
      table += Row({absl::StrCat(what, ": ", workload.name), Ratio(a, b), target});
    };
    // These bounds are for models that read only a raster.
    const std::string read = StageName(Stage::kReadScene, spec);
    const std::string network = StageName(Stage::kSceneNetwork, spec);
    row(read + " / " + network, times.Of(Stage::kReadScene), times.Of(Stage::kSceneNetwork),
        raster ? "at most 0.25" : "-");
    row("distributions of 4 actions / " + network, times.Of(Stage::kDistributions),
        times.Of(Stage::kSceneNetwork), raster ? "at most 0.15" : "-");
    row(raster ? "other than raster and networks / sum of the stages"
               : "other than reading and networks / sum of the stages",
        times.Rest(), times.AllStages(), raster ? "at most 0.15" : "-");
    row("whole answer / sum of the stages", times.together, times.AllStages(), "about 1");
  }
  return table;
}

// Returns the operations of backbone and p(y|s): two for each multiply-add.
double EncodeOperations(const v1::ModelSpec& spec) {
  const v1::ModelCost cost = artifact::CountCost(spec);
  return 2.0 * static_cast<double>(cost.backbone_multiply_adds() + cost.vector_multiply_adds() +
                                   cost.predictor_multiply_adds());
}

// Returns the row of one model in the table of models, measured on one scene.
std::string ModelRow(const BenchModel& model, const ReportOptions& options,
                     YardstickTimes* yardsticks) {
  Pipelines pipelines;
  pipelines.push_back(std::make_unique<Pipeline>(
      model, std::vector{RequestFor({options.scenes.front().scenes.front()}, kDescribedActions)},
      kDescribedActions));
  std::vector<std::function<void()>> things;
  AddStages(pipelines, &things);
  yardsticks->Add(&things);
  const v1::ModelSpec& spec = model.model->spec();
  const bool peer = options.libtorch && !spec.has_scene_vectors();
  if (peer) things.push_back(options.libtorch(*model.stored, pipelines.front()->scenes()));
  const std::vector<Series> series = MeasureInTurn(things, options.seconds, options.rounds);
  std::span<const Series> rest = series;
  const StageTimes times = TakeStages(pipelines, &rest);
  yardsticks->Take(&rest);
  const Series encode = Sum({times.Of(Stage::kSceneNetwork), times.Of(Stage::kHeads)});
  const artifact::GridSize raster = artifact::RasterGrid(spec.raster());
  std::vector<std::string> cells = {
      model.name,
      spec.has_raster() ? absl::StrFormat("%dx%dx%d", raster.height, raster.width, raster.channels)
                        : "-",
      std::string(model.model->precision()),
      Short(EncodeOperations(spec) / 2e6),
      Microseconds(times.Of(Stage::kReadScene)),
      Microseconds(times.Of(Stage::kSceneNetwork)),
      Microseconds(times.Of(Stage::kHeads)),
      Microseconds(times.Of(Stage::kDistributions)),
      yardsticks->ShareOfPeak(EncodeOperations(spec), encode, model.model->precision() == "bf16"),
      Ratio(times.Of(Stage::kReadScene), times.Of(Stage::kSceneNetwork)),
      Ratio(times.Of(Stage::kDistributions), times.Of(Stage::kSceneNetwork))};
  if (options.libtorch && !peer) cells.push_back("-");
  if (peer) {
    Series theirs = rest.front();
    for (double& seconds : theirs) seconds /= pipelines.front()->targets();
    cells.push_back(Ratio(theirs, encode));
  }
  return Row(cells);
}

std::string GrowthText(const GrowthCurve& growth, const std::string& folder) {
  const Chart& chart = growth.chart;
  std::string text =
      absl::StrCat("### ", chart.title, "\n\n![", chart.title, "](", folder, growth.file, ")\n\n");
  std::vector<std::string> head = {chart.x_title};
  for (const Curve& curve : chart.curves) head.push_back(curve.name);
  text += Header(head);
  for (size_t i = 0; i < chart.x.size(); ++i) {
    std::vector<std::string> cells = {absl::StrFormat("%.0f", chart.x[i])};
    for (const Curve& curve : chart.curves) cells.push_back(Short(curve.y[i]));
    text += Row(cells);
  }
  text += "\n";
  if (chart.logarithmic_x) return text;
  for (const Curve& curve : chart.curves) {
    const StraightLine line = FitLine(chart.x, curve.y);
    absl::StrAppendFormat(
        &text, "- %s: %.1f + %.3g x, where x is the first column, within %s at every point\n",
        curve.name, line.constant, line.slope, Percent(line.furthest));
  }
  return text + "\n";
}

absl::Status WriteText(const std::filesystem::path& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  file.close();
  if (!file) return absl::UnavailableError(absl::StrCat("cannot write ", path.string()));
  return absl::OkStatus();
}

std::string Introduction(const ReportOptions& options) {
  std::string text = absl::StrFormat(
      "%s, %d cores. Maneuver %s, %s, %s%s. Times are processor time of one core in process, "
      "without gRPC and without waiting. Each is a median over rounds in which everything that one "
      "table compares takes turns. Each stage and each request runs right after a whole answer, so "
      "the caches hold what a busy worker's hold.\n\n",
      ProcessorName(), machine::UsableCores(), kGitRevision, kBuildType, kCompiler,
      inference::ProcessorHasBf16() ? "" : "; bf16: not on this processor");
  for (const SceneSet& set : options.scenes) {
    double agents = 0, points = 0;
    for (const v1::Scenario& scene : set.scenes) {
      agents += scene.agents_size();
      points += static_cast<double>(MapPoints(scene));
    }
    const double count = static_cast<double>(set.scenes.size());
    absl::StrAppendFormat(&text, "- %s: %d, on average %.0f agents and %.0f map points\n", set.name,
                          set.scenes.size(), agents / count, points / count);
  }
  return text;
}

// Returns how the answers in the model's precision differ from those in f32; empty if it is f32.
std::string PrecisionText(const BenchModel& model, const std::vector<SceneSet>& sets) {
  const std::string precision(model.model->precision());
  if (precision == "f32") return "";
  std::string text = absl::StrCat(
      "\n## ", precision, " beside f32\n\nHow much the answers of ", model.name, " differ between ",
      precision,
      " and f32. Waypoints are those of the mean trajectories of actions with p(y|s) of at least ",
      kLikely, ".\n\n",
      Header({"scenes", "targets", "p(y\\|s): mean", "largest", "waypoint, m: mean", "largest"}));
  for (const SceneSet& set : sets) {
    const PrecisionChange change = ChangeFromF32(model, set.scenes);
    absl::StrAppendFormat(&text, "| %s | %d | %.5f | %.4f | %.4f | %.3f |\n", set.name,
                          change.targets, change.mean_probability, change.largest_probability,
                          change.mean_waypoint, change.largest_waypoint);
  }
  return text;
}

std::string WorkerText(const BenchModel& model, const SceneSet& set, const ReportOptions& options) {
  const std::vector<WorkerSpeed> speeds =
      MeasureWorkers(model, set.scenes, options.seconds, options.rounds);
  std::string text = absl::StrCat(
      "\n## Workers\n\nTargets a second by wall clock for ", model.name, ", ", set.name,
      ". The scheduler and its workers run in process, without gRPC and without "
      "callers, which would need the same cores. The rows take turns.\n\n",
      Header({"workers", "targets a second", "/ 1 worker"}));
  for (const WorkerSpeed& speed : speeds) {
    text +=
        Row({absl::StrCat(speed.workers), absl::StrFormat("%.0f", Median(speed.targets_per_second)),
             Ratio(speed.targets_per_second, speeds.front().targets_per_second)});
  }
  return text;
}

}  // namespace

absl::Status WriteReport(const ReportOptions& options) {
  const BenchModel& model = options.models.front();
  YardstickTimes yardsticks(options.yardstick_bytes);
  std::vector<Workload> workloads = MakeWorkloads(model, options.scenes);
  std::vector<std::function<void()>> things;
  for (const Workload& workload : workloads) AddStages(workload.pipelines, &things);
  yardsticks.Add(&things);
  const std::vector<Series> series = MeasureInTurn(things, options.seconds, options.rounds);
  std::span<const Series> rest = series;
  for (Workload& workload : workloads) workload.times = TakeStages(workload.pipelines, &rest);
  yardsticks.Take(&rest);

  std::string folder =
      std::filesystem::relative(options.pictures, options.file.parent_path()).string();
  folder = folder == "." || folder.empty() ? "" : folder + "/";
  const std::string title = absl::StrCat("Where the time of a target goes: ", model.name);
  std::string text = absl::StrCat(Introduction(options), "\n", yardsticks.Table(), "\n## ", title,
                                  "\n\n![", title, "](", folder, "performance-stages.svg)\n\n",
                                  StageTable(model.model->spec(), workloads), "\n",
                                  RatioTable(model.model->spec(), workloads), "\n");
  absl::Status status = WriteText(options.pictures / "performance-stages.svg",
                                  StagePicture(title, model.model->spec(), workloads));
  if (!status.ok()) return status;

  text +=
      "## Models\n\nMicroseconds a target, for a request of 8 targets of one scene. \"Read scene\" "
      "draws the raster, or reads the target's history, lane paths and agents nearby as vectors. "
      "The scene network is the backbone, or the network that joins these vectors. The share of "
      "the peak counts multiplications that are skipped as done, so it can exceed 100 %.\n\n";
  std::vector<std::string> head = {"model",
                                   "raster",
                                   "precision",
                                   "million multiply-adds",
                                   "read scene",
                                   "scene network",
                                   "heads",
                                   "distributions of 4",
                                   "networks, share of the peak",
                                   "read scene / network",
                                   "distributions / network"};
  if (options.libtorch) head.push_back("LibTorch / engine, backbone and p(y\\|s)");
  text += Header(head);
  for (const BenchModel& one : options.models) text += ModelRow(one, options, &yardsticks);

  text += PrecisionText(model, options.scenes);
  text += WorkerText(model, options.scenes.front(), options);
  text += "\n## Growth\n\n";
  const GrowthOptions growth{options.seconds, options.rounds, options.most_targets};
  for (const GrowthCurve& curve : MeasureGrowth(model, options.scenes.front().scenes, growth)) {
    text += GrowthText(curve, folder);
    status = WriteText(options.pictures / curve.file, DrawChart(curve.chart));
    if (!status.ok()) return status;
  }
  return WriteText(options.file, text);
}

}  // namespace maneuver::bench
