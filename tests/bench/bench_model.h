// Models to measure: presets with random weights, on which no time depends, and stored ones.

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
#include "model/inference/networks.h"

namespace maneuver::bench {

// Presets of training settings; and the compact networks on the raster that the paper's take.
inline constexpr const char* kCompactWide = "compact-224";
inline constexpr const char* kLanes = "lanes";  // reads vectors, no raster
inline constexpr const char* kPresets[] = {kLanes, "compact", kCompactWide, "paper", "resnet50"};
inline constexpr int kBatches[] = {1, 8};
inline constexpr int kLargestBatch = 8;

// The model of a preset as stored, made once.
const artifact::StoredModel& StoredPreset(const std::string& preset);

// As the engine evaluates it, loaded once.
std::shared_ptr<const inference::ActionModel> LoadPreset(const std::string& preset,
                                                         inference::Precision precision);

// A model whose parts are to be measured alone, too.
struct BenchModel {
  std::string name;
  std::shared_ptr<const artifact::StoredModel> stored;
  std::shared_ptr<const inference::ActionModel> model;
  std::shared_ptr<const inference::Networks> networks;  // the model's own, once more
};
BenchModel PresetBenchModel(const std::string& preset);
// Errors: those of ActionModel::Load.
absl::StatusOr<BenchModel> FolderBenchModel(const std::filesystem::path& folder);
// The same once more, in a precision that the processor has.
BenchModel WithPrecision(const BenchModel& model, inference::Precision precision);

// Another evaluation of a model's backbone and p(y|s), ready to be run on these scenes.
using PeerEncode = std::function<void()>;
using MakePeer =
    std::function<PeerEncode(const artifact::StoredModel&, std::span<const inference::SceneInput>)>;
// LibTorch's, on one thread, channels last, without gradients; of a model without scene vectors.
PeerEncode LibTorchEncode(const artifact::StoredModel& model,
                          std::span<const inference::SceneInput> scenes);

// kLargestBatch scenes for the preset: rasters as sparse as real ones, without motion; or random
// vectors with as many lane paths and agents as there can be.
std::span<const inference::SceneInput> Scenes(const std::string& preset);

// Notes the time of one target when each iteration was of `batch` targets.
void CountTargets(benchmark::State& state, int batch);

void RegisterEngineBenchmarks();
void RegisterLanePathBenchmarks();
void RegisterMapBenchmarks();
void RegisterStageBenchmarks();
void RegisterLibTorchBenchmarks();

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_BENCH_MODEL_H_
