// Models to measure: presets with random weights, on which no time depends.

#ifndef MANEUVER_TESTS_BENCH_BENCH_MODEL_H_
#define MANEUVER_TESTS_BENCH_BENCH_MODEL_H_

#include <benchmark/benchmark.h>

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "model/artifact/model_folder.h"
#include "model/inference/action_model.h"

namespace maneuver::bench {

inline constexpr const char* kPresets[] = {"compact", "paper", "resnet50"};
inline constexpr int kBatches[] = {1, 8};
inline constexpr int kLargestBatch = 8;

// The model of a preset as stored, made once.
const artifact::StoredModel& StoredPreset(const std::string& preset);

// As the engine evaluates it, loaded once.
std::shared_ptr<const inference::ActionModel> LoadPreset(const std::string& preset,
                                                         inference::Precision precision);

// kLargestBatch rasters of the preset, each as sparse as a real one; without motion.
std::span<const inference::SceneInput> Scenes(const std::string& preset);

// Notes the time of one target when each iteration was of `batch` targets.
void CountTargets(benchmark::State& state, int batch);

void RegisterEngineBenchmarks();
void RegisterMapBenchmarks();
void RegisterLibTorchBenchmarks();

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_BENCH_MODEL_H_
