// How an epoch over more recordings than fit in memory is divided. No LibTorch in this header.

#ifndef MANEUVER_MODEL_LEARNING_EPOCH_WINDOWS_H_
#define MANEUVER_MODEL_LEARNING_EPOCH_WINDOWS_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace maneuver::learning {

// A recording that can be learned from, before it is read.
struct UnreadRecording {
  int folder = 0;        // of the run
  size_t index = 0;      // in the folder's RecordingIndex
  int64_t examples = 0;  // training examples in it, at least 1
  int64_t bytes = 0;     // of memory that it takes once it is read
};

// Recordings that are in memory together, and the steps that learn from them.
struct EpochWindow {
  std::vector<size_t> recordings;  // into those that were planned with
  int64_t first_step = 0;          // of the epoch
  int64_t steps = 0;
};

struct WindowSizes {
  int64_t epoch_steps = 0;
  int64_t batch_size = 0;
  int64_t bytes = 0;  // of memory that the recordings of a window may take
};

// Divides an epoch into windows. Recordings come in an order drawn by (seed, epoch): each of them
// once before any of them again, and the recordings of each folder by its weight. A window is full
// when one more recording would exceed its bytes, but has at least one whole batch. All steps of a
// window are whole batches; the examples that are left over are not learned from in this epoch.
// The windows together have exactly epoch_steps steps.
//   recordings: at least one
//   weights: of each folder, positive; empty: all recordings count alike
std::vector<EpochWindow> PlanWindows(std::span<const UnreadRecording> recordings,
                                     std::span<const double> weights, const WindowSizes& sizes,
                                     uint64_t seed, int epoch);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_EPOCH_WINDOWS_H_
