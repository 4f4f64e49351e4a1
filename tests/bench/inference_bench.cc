// Time of the engine on one core: encoding by preset and batch, describing by number of actions,
// classifying. Random weights; the time does not depend on them.

#include <benchmark/benchmark.h>

#include <filesystem>
#include <map>
#include <numeric>
#include <string>

#include "model/artifact/training_presets.h"
#include "model/inference/action_model.h"
#include "tests/unit/model/inference/reference_model.h"

namespace maneuver::inference {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPresets[] = {"compact", "paper"};
constexpr int kMaxBatch = 32;

struct Setup {
  std::shared_ptr<const ActionModel> model;
  std::vector<std::vector<uint8_t>> rasters;
  std::vector<SceneInput> scenes;
};

// The model of a preset, made once.
const Setup& Prepare(const std::string& preset) {
  static std::map<std::string, Setup> setups;
  Setup& setup = setups[preset];
  if (setup.model != nullptr) return setup;
  v1::TrainingSettings settings;
  settings.set_preset(preset);
  const v1::ModelSpec spec = artifact::ResolveTrainingSettings(settings).model();
  const fs::path folder = fs::temp_directory_path() / ("inference-bench-" + preset);
  fs::remove_all(folder);
  const auto written = artifact::WriteModelFolder(folder, RandomModel(spec, 1));
  if (!written.ok()) std::abort();
  setup.model = ActionModel::Load(folder, {}).value();
  fs::remove_all(folder);
  for (uint32_t i = 0; i < kMaxBatch; ++i) setup.rasters.push_back(RandomRaster(spec, i));
  for (const auto& raster : setup.rasters) setup.scenes.push_back({raster.data(), {}});
  return setup;
}

void SetLabel(benchmark::State& state, const Setup& setup, const char* preset) {
  state.SetLabel(std::string(preset) + " " + std::string(setup.model->precision()));
}

void BM_Encode(benchmark::State& state) {
  const char* preset = kPresets[state.range(0)];
  const Setup& setup = Prepare(preset);
  const auto session = setup.model->NewSession();
  const size_t batch = static_cast<size_t>(state.range(1));
  std::vector<SceneEncoding> encodings(batch);
  for (auto _ : state) {
    session->Encode(std::span(setup.scenes).first(batch), encodings);
  }
  state.SetItemsProcessed(state.iterations() * state.range(1));
  SetLabel(state, setup, preset);
}
BENCHMARK(BM_Encode)
    ->ArgNames({"preset", "batch"})
    ->ArgsProduct({{0, 1}, {1, 8, kMaxBatch}})
    ->Unit(benchmark::kMicrosecond);

void BM_Describe(benchmark::State& state) {
  const char* preset = kPresets[state.range(0)];
  const Setup& setup = Prepare(preset);
  const auto session = setup.model->NewSession();
  std::vector<SceneEncoding> encoding(1);
  session->Encode(std::span(setup.scenes).first(1), encoding);
  std::vector<int> actions(static_cast<size_t>(state.range(1)));
  std::iota(actions.begin(), actions.end(), 0);
  for (auto _ : state) {
    benchmark::DoNotOptimize(session->Describe(encoding[0], actions, LatentSource::kPosterior));
  }
  state.SetItemsProcessed(state.iterations() * state.range(1));
  SetLabel(state, setup, preset);
}
BENCHMARK(BM_Describe)
    ->ArgNames({"preset", "actions"})
    ->ArgsProduct({{0, 1}, {1, 6, 25}})
    ->Unit(benchmark::kMicrosecond);

void BM_Classify(benchmark::State& state) {
  const char* preset = kPresets[state.range(0)];
  const Setup& setup = Prepare(preset);
  const auto session = setup.model->NewSession();
  std::vector<SceneEncoding> encoding(1);
  session->Encode(std::span(setup.scenes).first(1), encoding);
  const Trajectory trajectory = Trajectory::Random(setup.model->spec().trajectory().waypoints(), 2);
  for (auto _ : state) benchmark::DoNotOptimize(session->Classify(encoding[0], trajectory));
  SetLabel(state, setup, preset);
}
BENCHMARK(BM_Classify)->ArgName("preset")->DenseRange(0, 1)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace maneuver::inference
