// Draws the rasters of a pass over examples ahead of the one who needs them.

#ifndef MANEUVER_MODEL_LEARNING_RASTER_LOADER_H_
#define MANEUVER_MODEL_LEARNING_RASTER_LOADER_H_

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <thread>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/training_data.h"
#include "model/scene/road_map.h"

namespace maneuver::learning {

// How an example is varied. The default varies nothing.
struct Variation {
  bool mirror = false;
  double scale = 1.0;
  double shift_x = 0.0;      // pixels, raster alone
  double shift_y = 0.0;      // pixels, raster alone
  double rotation = 0.0;     // radians: the target's frame turns by so much under the world
  double drop_agents = 0.0;  // share of the other agents that are left out, raster alone
  uint64_t drop_seed = 0;    // which ones
  int frames = INT32_MAX;    // that agents were seen in, the present included, raster alone
};

// The variation of an example in an epoch: a function of its arguments alone, so that it does not
// matter which thread asks and in which order.
//   history_frames: of the raster
Variation DrawVariation(const v1::AugmentationSettings& settings, int history_frames, uint64_t seed,
                        int epoch, int64_t example);

// x as the variation has it: turned, scaled and mirrored. In place, [T, 2] target frame, metres.
void ApplyVariation(const Variation& variation, std::span<float> trajectory);

// The target's motion as the variation has it.
scene::MotionInputs VariedMotion(const Variation& variation, const scene::MotionInputs& motion);

// Rasters on the fly: every pass draws them anew, varied as asked, so that memory does not grow
// with the number of examples and the scale is exact (lines stay one pixel wide).
class RasterLoader {
 public:
  struct Item {
    int64_t example = 0;
    Variation variation;
  };
  struct Batch {
    std::vector<Item> items;
    std::vector<uint8_t> rasters;  // [B, H, W, C]
    // How long Next waited for it: 0 if it was ready. The first batch has what it took to make the
    // loader as well.
    std::chrono::nanoseconds waited{0};
  };

  // One pass: `items` in batches of `batch_size` (the last one may be smaller), drawn by `threads`
  // threads that are at most a few batches ahead. `set` must outlive the loader.
  RasterLoader(const v1::RasterSpec& spec, const ExampleSet& set, std::vector<Item> items,
               int64_t batch_size, int threads);
  // Stops the threads, whether or not the pass is over.
  ~RasterLoader();
  RasterLoader(const RasterLoader&) = delete;
  RasterLoader& operator=(const RasterLoader&) = delete;

  // The next batch, in order; nothing when the pass is over.
  std::optional<Batch> Next();

 private:
  static constexpr size_t kAhead = 4;  // batches

  void Work();

  const v1::RasterSpec spec_;
  const ExampleSet& set_;
  std::vector<scene::RoadMap> maps_;  // [recordings]
  const std::vector<Item> items_;
  const size_t batch_size_;
  const size_t batches_;
  std::chrono::nanoseconds making_{0};  // the loader, until the first batch has it

  std::mutex mutex_;
  std::condition_variable changed_;
  // Guarded by mutex_:
  size_t claimed_ = 0;  // batches that a thread has begun
  size_t taken_ = 0;    // batches that Next has given out
  bool stopping_ = false;
  std::vector<std::optional<Batch>> ready_;  // ring of kAhead, batch i at i % kAhead

  std::vector<std::jthread> threads_;
};

// What is left of an epoch: its examples from `first` on, in their order, each varied anew, also
// one that comes again.
//   settings: complete
std::vector<RasterLoader::Item> VariedItems(const v1::TrainingSettings& settings,
                                            std::span<const int64_t> order, int64_t first,
                                            int epoch);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_RASTER_LOADER_H_
