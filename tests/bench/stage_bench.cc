// Each stage of an answer alone, and all together, of a model with a raster and of one with lane
// paths, on recorded and on synthetic scenes: 8 targets of one scene; all together for one target;
// all together with six representatives; and all together for 2, 4 and 8 targets with the two most
// probable actions, alone and with six joint combinations. MANEUVER_REAL_DATA as in map_bench.cc.

#include <benchmark/benchmark.h>

#include <compare>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tests/bench/bench_scenes.h"
#include "tests/bench/pipeline.h"

namespace maneuver::bench {
namespace {

constexpr int kActions = 4;
constexpr char kCompact[] = "compact";

// The question about the first scene.
struct Question {
  std::string preset = kCompact;
  int targets = kLargestBatch;
  int actions = kActions;
  int representatives = 0;
  int combinations = 0;
  auto operator<=>(const Question&) const = default;
};

// Returns the pipeline of the first scene; nullptr if there is none.
Pipeline* FirstScene(bool recorded, const Question& question) {
  static std::map<std::string, BenchModel> models;
  static std::map<std::pair<bool, Question>, std::unique_ptr<Pipeline>> pipelines;
  std::unique_ptr<Pipeline>& pipeline = pipelines[{recorded, question}];
  if (pipeline == nullptr) {
    const auto scenes =
        recorded ? WaymoScenes(question.targets, 1) : TownScenes(question.targets, 1);
    if (scenes.empty()) return nullptr;
    const auto model = models.try_emplace(question.preset, PresetBenchModel(question.preset)).first;
    pipeline = std::make_unique<Pipeline>(
        model->second, std::vector{RequestFor(scenes, question.actions)}, question.actions,
        question.representatives, question.combinations);
  }
  return pipeline.get();
}

void Measure(benchmark::State& state, bool recorded, const Question& question,
             const std::function<void(Pipeline&)>& run) {
  Pipeline* pipeline = FirstScene(recorded, question);
  if (pipeline == nullptr) return state.SkipWithError("MANEUVER_REAL_DATA has no such scene");
  pipeline->RunAll();
  for (auto _ : state) run(*pipeline);
  CountTargets(state, pipeline->targets());
}

// Registers stages/NAME/... for the compact preset, and stages/PRESET/NAME/... for others.
void Register(const std::string& name, const Question& question,
              const std::function<void(Pipeline&)>& run) {
  for (const bool recorded : {true, false}) {
    const std::string full =
        (question.preset == kCompact ? "stages/" : "stages/" + question.preset + "/") + name +
        (recorded ? "/recorded" : "/town");
    benchmark::RegisterBenchmark(full.c_str(), Measure, recorded, question, run)
        ->Unit(benchmark::kMicrosecond);
  }
}

}  // namespace

void RegisterStageBenchmarks() {
  for (const std::string preset : {kCompact, kLanes}) {
    const v1::ModelSpec& spec = StoredPreset(preset).manifest.spec();
    for (int i = 0; i < kStages; ++i) {
      const Stage stage = static_cast<Stage>(i);
      Register(StageName(stage, spec), {.preset = preset},
               [stage](Pipeline& pipeline) { pipeline.Run(stage); });
    }
    const auto all = [](Pipeline& pipeline) { pipeline.RunAll(); };
    Register("all", {.preset = preset}, all);
    Register("one_target", {.preset = preset, .targets = 1}, all);
    // Six answers per target: the most probable actions, or representatives.
    Register("six_actions", {.preset = preset, .actions = 6}, all);
    Register("six_representatives", {.preset = preset, .actions = 0, .representatives = 6}, all);
    for (const int targets : {2, 4, 8}) {
      const std::string name = "joint/" + std::to_string(targets) + "_targets/";
      Register(name + "without", {.preset = preset, .targets = targets, .actions = 2}, all);
      Register(name + "six_combinations",
               {.preset = preset, .targets = targets, .actions = 2, .combinations = 6}, all);
    }
  }
}

}  // namespace maneuver::bench
