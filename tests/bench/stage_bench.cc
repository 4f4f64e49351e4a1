// Each stage of an answer alone, and all together, on recorded and on synthetic scenes: 8 targets
// of one scene; and all together for one target. MANEUVER_REAL_DATA as in map_bench.cc.

#include <benchmark/benchmark.h>

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

// nullptr: there is no such scene.
Pipeline* FirstScene(bool recorded, int targets) {
  static const BenchModel model = PresetBenchModel("compact");
  static std::map<std::pair<bool, int>, std::unique_ptr<Pipeline>> pipelines;
  std::unique_ptr<Pipeline>& pipeline = pipelines[{recorded, targets}];
  if (pipeline == nullptr) {
    const auto scenes = recorded ? WaymoScenes(targets, 1) : TownScenes(targets, 1);
    if (scenes.empty()) return nullptr;
    pipeline =
        std::make_unique<Pipeline>(model, std::vector{RequestFor(scenes, kActions)}, kActions);
  }
  return pipeline.get();
}

void Measure(benchmark::State& state, bool recorded, int targets,
             const std::function<void(Pipeline&)>& run) {
  Pipeline* pipeline = FirstScene(recorded, targets);
  if (pipeline == nullptr) return state.SkipWithError("MANEUVER_REAL_DATA has no such scene");
  pipeline->RunAll();
  for (auto _ : state) run(*pipeline);
  CountTargets(state, pipeline->targets());
}

void Register(const std::string& name, int targets, const std::function<void(Pipeline&)>& run) {
  for (const bool recorded : {true, false}) {
    benchmark::RegisterBenchmark(("stages/" + name + (recorded ? "/recorded" : "/town")).c_str(),
                                 Measure, recorded, targets, run)
        ->Unit(benchmark::kMicrosecond);
  }
}

}  // namespace

void RegisterStageBenchmarks() {
  for (int i = 0; i < kStages; ++i) {
    const Stage stage = static_cast<Stage>(i);
    Register(StageName(stage), kLargestBatch, [stage](Pipeline& pipeline) { pipeline.Run(stage); });
  }
  const auto all = [](Pipeline& pipeline) { pipeline.RunAll(); };
  Register("all", kLargestBatch, all);
  Register("one_target", 1, all);
}

}  // namespace maneuver::bench
