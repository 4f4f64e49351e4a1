#include "tests/bench/curves.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tests/bench/bench_scenes.h"
#include "tests/bench/stage_times.h"

namespace maneuver::bench {
namespace {

// Measures the stages of one request for each point, in turn.
std::vector<StageTimes> MeasureStages(const BenchModel& model,
                                      const std::vector<v1::PredictRequest>& requests,
                                      const std::vector<int>& actions,
                                      const GrowthOptions& options) {
  std::vector<Pipelines> points(requests.size());
  std::vector<std::function<void()>> things;
  for (size_t i = 0; i < requests.size(); ++i) {
    points[i].push_back(std::make_unique<Pipeline>(model, std::vector{requests[i]}, actions[i]));
    AddStages(points[i], &things);
  }
  const std::vector<Series> series = MeasureInTurn(things, options.seconds, options.rounds);
  std::span<const Series> rest = series;
  std::vector<StageTimes> times;
  for (const Pipelines& pipelines : points) times.push_back(TakeStages(pipelines, &rest));
  return times;
}

Curve CurveOf(const std::string& name, const std::vector<StageTimes>& times,
              const std::vector<Stage>& stages) {
  Curve curve{name, {}};
  for (const StageTimes& time : times) {
    std::vector<Series> parts;
    for (const Stage stage : stages) parts.push_back(time.Of(stage));
    curve.y.push_back(kMicroseconds * Median(Sum(parts)));
  }
  return curve;
}

const std::vector<Stage> kEveryStage = {
    Stage::kParse, Stage::kValidate,      Stage::kReadScene, Stage::kSceneNetwork,
    Stage::kHeads, Stage::kDistributions, Stage::kAnswer,    Stage::kSerialize};

// Measures over a property of the scene that affects parsing, validation and raster.
GrowthCurve OverScenes(const BenchModel& model, const std::vector<v1::Scenario>& scenes,
                       std::vector<double> x, const GrowthOptions& options) {
  std::vector<v1::PredictRequest> requests;
  for (const v1::Scenario& scene : scenes)
    requests.push_back(RequestFor({scene}, kDescribedActions));
  const auto times =
      MeasureStages(model, requests, std::vector<int>(requests.size(), kDescribedActions), options);
  GrowthCurve curve;
  curve.chart.y_title = "microseconds a target";
  curve.chart.x = std::move(x);
  curve.chart.curves = {
      CurveOf("whole answer", times, kEveryStage),
      CurveOf(StageName(Stage::kReadScene, model.model->spec()), times, {Stage::kReadScene}),
      CurveOf("parse, validate", times, {Stage::kParse, Stage::kValidate})};
  return curve;
}

GrowthCurve OverAgents(const BenchModel& model, const v1::Scenario& scene,
                       const GrowthOptions& options) {
  std::vector<v1::Scenario> scenes;
  std::vector<double> x;
  for (const int others : {0, 50, 100, 200, 400}) {
    scenes.push_back(WithAgents(scene, others));
    x.push_back(scenes.back().agents_size());
  }
  GrowthCurve curve = OverScenes(model, scenes, std::move(x), options);
  curve.file = "performance-agents.svg";
  curve.chart.title = "Cost by number of agents in the scene";
  curve.chart.x_title = "agents, 8 of them targets of the request";
  return curve;
}

GrowthCurve OverMapPoints(const BenchModel& model, const v1::Scenario& scene,
                          const GrowthOptions& options) {
  std::vector<v1::Scenario> scenes;
  std::vector<double> x;
  for (const int64_t points : {0, 2'500, 5'000, 10'000, 20'000, 40'000}) {
    scenes.push_back(WithMapPoints(scene, points));
    x.push_back(static_cast<double>(MapPoints(scenes.back())));
  }
  GrowthCurve curve = OverScenes(model, scenes, std::move(x), options);
  curve.file = "performance-map.svg";
  curve.chart.title = "Cost by number of map points";
  curve.chart.x_title = "map points, request of 8 targets";
  return curve;
}

GrowthCurve OverActions(const BenchModel& model, const v1::Scenario& scene,
                        const GrowthOptions& options) {
  std::vector<v1::PredictRequest> requests;
  std::vector<int> actions;
  const int most = model.model->spec().actions();
  for (const int count : {1, 2, 4, 8, 16, 25}) {
    if (count > most) continue;
    requests.push_back(RequestFor({scene}, count));
    actions.push_back(count);
  }
  const auto times = MeasureStages(model, requests, actions, options);
  GrowthCurve curve;
  curve.file = "performance-actions.svg";
  curve.chart.title = "Cost by number of actions described";
  curve.chart.x_title = "actions described for each target";
  curve.chart.y_title = "microseconds a target";
  curve.chart.x.assign(actions.begin(), actions.end());
  curve.chart.curves = {CurveOf("whole answer", times, kEveryStage),
                        CurveOf("distributions", times, {Stage::kDistributions}),
                        CurveOf("answer, serialise", times, {Stage::kAnswer, Stage::kSerialize})};
  return curve;
}

// Measures requests of 1 to many targets: scenes with eight targets, the last one with the rest.
GrowthCurve OverTargets(const BenchModel& model, const std::vector<v1::Scenario>& scenes,
                        const GrowthOptions& options) {
  GrowthCurve curve;
  curve.file = "performance-targets.svg";
  curve.chart.title = "Cost of a target by number of targets in a request";
  curve.chart.x_title = "targets in the request, 8 a scene";
  curve.chart.y_title = "microseconds a target";
  curve.chart.logarithmic_x = true;
  std::vector<std::unique_ptr<Pipeline>> pipelines;
  std::vector<std::function<void()>> things;
  for (const int targets : {1, 2, 4, 8, 16, 64, 256, 1'000}) {
    if (targets > options.most_targets) continue;
    std::vector<v1::Scenario> asked;
    for (int left = targets; left > 0; left -= kLargestBatch) {
      asked.push_back(scenes[asked.size() % scenes.size()]);
      asked.back().mutable_target_ids()->Truncate(std::min(left, kLargestBatch));
    }
    pipelines.push_back(std::make_unique<Pipeline>(
        model, std::vector{RequestFor(asked, kDescribedActions)}, kDescribedActions));
    // Runs twice and measures the second time, as for the stages.
    const auto run = [pipeline = pipelines.back().get()] { pipeline->RunAll(); };
    things.insert(things.end(), 2, run);
    curve.chart.x.push_back(targets);
  }
  const std::vector<Series> series = MeasureInTurn(things, options.seconds, options.rounds);
  curve.chart.curves = {{"whole answer", {}}};
  for (size_t i = 0; i < curve.chart.x.size(); ++i) {
    curve.chart.curves[0].y.push_back(kMicroseconds * Median(series[2 * i + 1]) / curve.chart.x[i]);
  }
  return curve;
}

}  // namespace

std::vector<GrowthCurve> MeasureGrowth(const BenchModel& model,
                                       const std::vector<v1::Scenario>& scenes,
                                       const GrowthOptions& options) {
  // The scene with the largest map represents all of them.
  const v1::Scenario& scene = *std::max_element(
      scenes.begin(), scenes.end(),
      [](const v1::Scenario& a, const v1::Scenario& b) { return MapPoints(a) < MapPoints(b); });
  return {OverTargets(model, scenes, options), OverAgents(model, scene, options),
          OverMapPoints(model, scene, options), OverActions(model, scene, options)};
}

StraightLine FitLine(const std::vector<double>& x, const std::vector<double>& y) {
  const double n = static_cast<double>(x.size());
  double sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (size_t i = 0; i < x.size(); ++i) {
    sx += x[i];
    sy += y[i];
    sxx += x[i] * x[i];
    sxy += x[i] * y[i];
  }
  StraightLine line;
  line.slope = (n * sxy - sx * sy) / (n * sxx - sx * sx);
  line.constant = (sy - line.slope * sx) / n;
  for (size_t i = 0; i < x.size(); ++i) {
    line.furthest =
        std::max(line.furthest, std::abs(line.constant + line.slope * x[i] - y[i]) / y[i]);
  }
  return line;
}

}  // namespace maneuver::bench
