// Provides models to measure: presets with random weights, whose values do not affect the times,
// and stored models.

#ifndef MANEUVER_TESTS_BENCH_BENCH_MODEL_H_
#define MANEUVER_TESTS_BENCH_BENCH_MODEL_H_

#include <benchmark/benchmark.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "model/artifact/model_folder.h"
#include "model/inference/action_model.h"
#include "model/inference/packed_networks.h"

namespace maneuver::bench {

// Names of presets of training settings. kCompactWide: the compact networks on the raster of the
// paper's preset.
inline constexpr const char* kCompactWide = "compact-224";
inline constexpr const char* kLanes = "lanes";  // reads vectors, no raster
inline constexpr const char* kPresets[] = {kLanes, "compact", kCompactWide, "paper", "resnet50"};
inline constexpr int kBatches[] = {1, 8};
inline constexpr int kLargestBatch = 8;

// Returns the stored model of a preset, which is made once.
const artifact::StoredModel& StoredPreset(const std::string& preset);

// Returns the model of a preset in the engine, loaded once.
std::shared_ptr<const inference::ActionModel> LoadPreset(const std::string& preset,
                                                         inference::Precision precision);

// A model whose parts are also measured separately.
struct BenchModel {
  std::string name;
  std::shared_ptr<const artifact::StoredModel> stored;
  std::shared_ptr<const inference::ActionModel> model;
  std::shared_ptr<const inference::PackedNetworks> networks;  // the model's own, once more
};
BenchModel PresetBenchModel(const std::string& preset);
// Loads a model folder. Errors: those of ActionModel::Load.
absl::StatusOr<BenchModel> FolderBenchModel(const std::filesystem::path& folder);
// Returns the same model in another precision, which the processor must have.
BenchModel WithPrecision(const BenchModel& model, inference::Precision precision);

// Evaluates a model's backbone and p(y|s) for given scenes by another program.
using PeerEncode = std::function<void()>;
using MakePeer = std::function<PeerEncode(const artifact::StoredModel&,
                                          std::span<const inference::SceneInputsView>)>;
// Returns LibTorch's evaluation, on one thread, channels last, without gradients. For models
// without scene vectors.
PeerEncode LibTorchEncode(const artifact::StoredModel& model,
                          std::span<const inference::SceneInputsView> scenes);

// Returns kLargestBatch scenes for the preset: rasters as sparse as real ones, without motion; or
// random vectors with the largest number of lane paths and agents.
std::span<const inference::SceneInputsView> Scenes(const std::string& preset);

// Reports the time of one target if each iteration had `batch` targets.
void CountTargets(benchmark::State& state, int batch);

void RegisterEngineBenchmarks();
void RegisterLanePathBenchmarks();
void RegisterMapBenchmarks();
void RegisterStageBenchmarks();
void RegisterLibTorchBenchmarks();

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_BENCH_MODEL_H_
