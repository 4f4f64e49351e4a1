// Measures the times of a pipeline's stages, in turn.

#ifndef MANEUVER_TESTS_BENCH_STAGE_TIMES_H_
#define MANEUVER_TESTS_BENCH_STAGE_TIMES_H_

#include <array>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "tests/bench/interleaved.h"
#include "tests/bench/pipeline.h"

namespace maneuver::bench {

using Pipelines = std::vector<std::unique_ptr<Pipeline>>;

inline constexpr double kMicroseconds = 1e6;  // of a second
inline constexpr int kDescribedActions = 4;   // where the number does not vary

// Seconds per target in each round.
struct StageTimes {
  std::array<Series, kStages> stages;
  Series scenario_encoders;  // part of the distributions
  Series decoder;            // part of the distributions
  Series together;           // by Pipeline::RunAll

  const Series& Of(Stage stage) const { return stages[static_cast<size_t>(stage)]; }
  // Returns the time of everything except raster and networks.
  Series Rest() const;
  Series AllStages() const;
};

// Adds things for MeasureInTurn: all stages of each pipeline, one pipeline after the other. Each
// stage runs after a whole answer, which fills the caches as in a busy worker.
void AddStages(const Pipelines& pipelines, std::vector<std::function<void()>>* things);
// Returns the times of the stages; takes their series from the front of `series`.
StageTimes TakeStages(const Pipelines& pipelines, std::span<const Series>* series);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_STAGE_TIMES_H_
