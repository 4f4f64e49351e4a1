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
  int folder = 0;        // index of the run's dataset folder
  size_t index = 0;      // in the folder's RecordingIndex
  int64_t examples = 0;  // training examples in it, at least 1
  int64_t bytes = 0;     // memory that it takes once it is read
};

// Recordings that are in memory together, and the steps that learn from them.
struct EpochWindow {
  std::vector<size_t> recordings;  // indices into the `recordings` of PlanWindows
  int64_t first_step = 0;          // counted from the epoch's start
  int64_t steps = 0;
};

struct WindowSizes {
  int64_t epoch_steps = 0;
  int64_t batch_size = 0;
  int64_t bytes = 0;  // most memory for the recordings of a window
};

// Divides an epoch into windows. (seed, epoch) determines the order of recordings. Within a folder,
// each recording comes once before any comes again. Folders take turns by their weights. A window
// is full when one more recording would exceed its bytes, but it has at least one whole batch. All
// steps of a window are whole batches; the epoch leaves out the remaining examples.
// The windows together have exactly epoch_steps steps.
//   recordings: at least one
//   weights: weight of each folder, positive; empty: all recordings count alike
std::vector<EpochWindow> PlanWindows(std::span<const UnreadRecording> recordings,
                                     std::span<const double> weights, const WindowSizes& sizes,
                                     uint64_t seed, int epoch);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_EPOCH_WINDOWS_H_
