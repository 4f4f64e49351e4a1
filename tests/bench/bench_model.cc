#include "tests/bench/bench_model.h"

#include <unistd.h>

#include <cstdlib>
#include <deque>
#include <filesystem>
#include <iostream>
#include <map>
#include <random>
#include <utility>

#include "model/artifact/training_presets.h"
#include "tests/unit/model/inference/reference_model.h"
#include "tests/unit/model/scene/raster_of.h"

namespace maneuver::bench {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void Fail(const absl::Status& status) {
  std::cerr << "maneuver-bench: " << status << "\n";
  std::exit(EXIT_FAILURE);
}

v1::ModelSpec SpecOf(const std::string& preset) {
  v1::TrainingSettings settings;
  settings.set_preset(preset);
  if (preset == kCompactWide) {
    settings.set_preset("compact");
    *settings.mutable_model()->mutable_raster() = SpecOf("paper").raster();
  }
  return artifact::ResolveTrainingSettings(settings).model();
}

scene::SceneVectors RandomVectors(uint32_t seed) {
  std::mt19937 generator(seed);
  std::normal_distribution<float> normal;
  scene::SceneVectors vectors;
  vectors.motion.speed = 10.0;
  for (float& value : vectors.history) value = normal(generator);
  vectors.paths.count = scene::kMostLanePaths;
  for (float& value : vectors.paths.values) value = normal(generator);
  vectors.agents.count = scene::kMostNearAgents;
  for (float& value : vectors.agents.values) value = normal(generator);
  return vectors;
}

}  // namespace

const artifact::StoredModel& StoredPreset(const std::string& preset) {
  static std::map<std::string, artifact::StoredModel> models;
  const auto found = models.find(preset);
  if (found != models.end()) return found->second;
  const v1::ModelSpec spec = SpecOf(preset);
  return models.emplace(preset, inference::RandomModel(spec, 1)).first->second;
}

std::shared_ptr<const inference::ActionModel> LoadPreset(const std::string& preset,
                                                         inference::Precision precision) {
  using Key = std::pair<std::string, inference::Precision>;
  static std::map<Key, std::shared_ptr<const inference::ActionModel>> models;
  std::shared_ptr<const inference::ActionModel>& model = models[{preset, precision}];
  if (model != nullptr) return model;
  const fs::path folder =
      fs::temp_directory_path() / ("maneuver-bench-" + std::to_string(getpid()));
  const absl::Status written = artifact::WriteModelFolder(folder, StoredPreset(preset));
  if (!written.ok()) Fail(written);
  auto loaded = inference::ActionModel::Load(folder, {precision});
  fs::remove_all(folder);
  if (!loaded.ok()) Fail(loaded.status());
  return model = *std::move(loaded);
}

BenchModel PresetBenchModel(const std::string& preset) {
  BenchModel model;
  model.name = preset;
  model.stored = std::make_shared<const artifact::StoredModel>(StoredPreset(preset));
  model.model = LoadPreset(preset, inference::Precision::kAuto);
  model.networks = std::make_shared<const inference::PackedNetworks>(
      model.model->spec(), model.stored->weights, model.model->precision() == "bf16");
  return model;
}

absl::StatusOr<BenchModel> FolderBenchModel(const fs::path& folder) {
  absl::StatusOr<artifact::StoredModel> stored = artifact::ReadModelFolder(folder);
  if (!stored.ok()) return stored.status();
  BenchModel model;
  model.name = fs::absolute(folder).lexically_normal().filename().string();
  model.stored = std::make_shared<const artifact::StoredModel>(*std::move(stored));
  auto loaded = inference::ActionModel::FromStored(*model.stored, {});
  if (!loaded.ok()) return loaded.status();
  model.model = *std::move(loaded);
  model.networks = std::make_shared<const inference::PackedNetworks>(
      model.model->spec(), model.stored->weights, model.model->precision() == "bf16");
  return model;
}

BenchModel WithPrecision(const BenchModel& model, inference::Precision precision) {
  BenchModel other = model;
  other.model = *inference::ActionModel::FromStored(*model.stored, {.precision = precision});
  other.networks = std::make_shared<const inference::PackedNetworks>(
      other.model->spec(), model.stored->weights, other.model->precision() == "bf16");
  return other;
}

std::span<const inference::SceneInputsView> Scenes(const std::string& preset) {
  static std::map<std::string, std::deque<scene::Raster>> rasters;
  static std::map<std::string, std::deque<scene::SceneVectors>> vectors;
  static std::map<std::string, std::vector<inference::SceneInputsView>> scenes;
  std::vector<inference::SceneInputsView>& found = scenes[preset];
  if (!found.empty()) return found;
  for (uint32_t i = 0; i < kLargestBatch; ++i) {
    const v1::ModelSpec& spec = StoredPreset(preset).manifest.spec();
    if (!spec.has_raster()) {
      vectors[preset].push_back(RandomVectors(i));
      found.push_back({nullptr, {}, &vectors[preset].back()});
      continue;
    }
    rasters[preset].push_back(
        scene::RasterOf(spec.raster(), inference::RandomRaster(spec, 2 * i + 1)));
    found.push_back({&rasters[preset].back(), {}});
  }
  return found;
}

void CountTargets(benchmark::State& state, int batch) {
  state.counters["a_target"] = benchmark::Counter(
      batch, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

}  // namespace maneuver::bench
