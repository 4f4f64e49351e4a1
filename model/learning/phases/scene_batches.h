// The batches of scenes of an epoch, wherever their recordings are.

#ifndef MANEUVER_MODEL_LEARNING_PHASES_SCENE_BATCHES_H_
#define MANEUVER_MODEL_LEARNING_PHASES_SCENE_BATCHES_H_

#include <atomic>
#include <cstdint>
#include <future>
#include <memory>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/learning/epoch_windows.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"
#include "model/learning/ranks/micro_batch_range.h"
#include "model/learning/scene_loader.h"

namespace maneuver::learning {

// Reads the batches of each epoch in order. If the data fit in memory, the order is the one that
// the loop has drawn. If they do not, an epoch goes through windows of recordings
// (epoch_windows.h): the next window is read while this one is learned from. Not thread-safe.
class SceneBatches {
 public:
  //   spec: of the model that reads the batches;  state: must outlive the batches
  //   range: which part of each batch to read, one micro-batch after another
  SceneBatches(const v1::ModelSpec& spec, const LearningState& state,
               const MicroBatchRange& range = {});
  // Waits until nothing is read any more.
  ~SceneBatches();
  SceneBatches(const SceneBatches&) = delete;
  SceneBatches& operator=(const SceneBatches&) = delete;

  struct LabelledBatch {
    SceneLoader::Batch batch;
    at::Tensor labels;   // as BatchLabels has them
    double share = 1.0;  // of the examples of the whole batch
  };

  // Errors: those of RecordingWindows::Load.
  absl::Status BeginEpoch(const EpochStart& start);
  // Returns the next micro-batch; call it once for each in the range, in each step of the epoch. It
  // may be empty if there are several. Errors: those of BeginEpoch.
  absl::StatusOr<LabelledBatch> Next();
  // Ends reading, whether or not the epoch is over.
  void EndEpoch();

 private:
  struct OpenWindow;

  // Waits for window next_, which is being read, opens it at batch `step` and begins to read the
  // window after it.
  absl::Status OpenNext(int64_t step);
  // Begins to read this rank's part of the batches of `items`.
  void BeginReading(const SceneSource& source, std::vector<SceneLoader::Item> items);
  // Begins to read a window of the epoch in the background.
  void ReadAhead(const EpochWindow& window);

  const v1::ModelSpec spec_;
  const LearningState& state_;
  const MicroBatchRange range_;
  std::optional<SceneLoader> loader_;  // of the epoch, or of the open window
  std::vector<double> shares_;         // of the loader's batches
  size_t taken_ = 0;                   // how many of them Next has returned
  // Used with windows only:
  int epoch_ = 0;
  std::vector<EpochWindow> windows_;
  size_t next_ = 0;  // window that is opened next
  std::unique_ptr<OpenWindow> open_;
  std::atomic<bool> ending_ = false;
  std::future<absl::StatusOr<std::unique_ptr<OpenWindow>>> ahead_;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_SCENE_BATCHES_H_
