// Reads the scenes of a pass over examples before they are needed.

#ifndef MANEUVER_MODEL_LEARNING_SCENE_LOADER_H_
#define MANEUVER_MODEL_LEARNING_SCENE_LOADER_H_

#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/epoch_windows.h"
#include "model/learning/scene_source.h"
#include "model/learning/scene_tensors.h"
#include "model/learning/variation.h"
#include "model/machine/ordered_work.h"

namespace maneuver::learning {

// Reads scenes on the fly. Every pass reads them anew with the given variations, so memory does not
// grow with the number of examples, and scales are exact: lines stay one pixel wide, and lane paths
// are sampled in the scaled world.
class SceneLoader {
 public:
  struct Item {
    int64_t example = 0;
    Variation variation;
  };
  struct Batch {
    std::vector<Item> items;
    SceneTensors scenes;
    at::Tensor trajectories;  // x - r(m), varied as the items say, [B, 2T] metres
    // How long Next waited for this batch: almost 0 if it was ready. For the first batch, it
    // includes the time that the loader's constructor took.
    std::chrono::nanoseconds waited{0};
  };

  static constexpr size_t kAhead = 4;  // batches

  // Begins a pass over `items` in batches of `batch_size`; the last one may be smaller. `threads`
  // threads read at most kAhead batches ahead. `source` must outlive the loader.
  SceneLoader(const v1::ModelSpec& spec, const SceneSource& source, std::vector<Item> items,
              int64_t batch_size, int threads);
  // Begins a pass in batches of different sizes.
  //   ends: index into `items` where each batch ends, ascending; equal ones make an empty batch
  //   ahead: the most batches that are read ahead
  SceneLoader(const v1::ModelSpec& spec, const SceneSource& source, std::vector<Item> items,
              std::vector<size_t> ends, size_t ahead, int threads);

  // Returns the next batch, in order; nothing at the end of the pass. Throws what reading it threw.
  std::optional<Batch> Next();

 private:
  void Work();

  const v1::ModelSpec spec_;
  const SceneSource& source_;
  const std::vector<Item> items_;
  const std::vector<size_t> ends_;      // index into items_ where each batch ends
  std::chrono::nanoseconds making_{0};  // time of the constructor, until the first batch reports it
  machine::OrderedWork<Batch> work_;    // last: its threads end before what they use
};

// Returns the rest of an epoch: its examples from `first` on, in their order. Each gets a new
// variation, even an example that repeats.
//   settings: complete
std::vector<SceneLoader::Item> VariedItems(const v1::TrainingSettings& settings,
                                           std::span<const int64_t> order, int64_t first,
                                           int epoch);

// Returns the items of the batches of a window from batch `first_step` of the window on, in an
// order drawn by (seed, epoch, window). An item is varied by its place in the epoch.
//   examples: number of examples in the window
//   epoch: from 0
std::vector<SceneLoader::Item> WindowItems(const v1::TrainingSettings& settings, int64_t examples,
                                           const EpochWindow& window, int64_t first_step,
                                           int epoch);

// Returns the items of an epoch, from its batch `first_step` on. A last batch of one example is
// left out (StepsOfEpoch).
//   epoch: from 0
std::vector<SceneLoader::Item> EpochItems(const v1::TrainingSettings& settings,
                                          std::span<const int64_t> order, int64_t first_step,
                                          int epoch);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_SCENE_LOADER_H_
