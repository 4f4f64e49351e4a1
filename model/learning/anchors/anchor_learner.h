// Trains the anchor baselines as the model was trained.

#ifndef MANEUVER_MODEL_LEARNING_ANCHORS_ANCHOR_LEARNER_H_
#define MANEUVER_MODEL_LEARNING_ANCHORS_ANCHOR_LEARNER_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/artifact/anchor_baselines.h"
#include "model/learning/anchors/anchor_networks.h"
#include "model/learning/checkpoint.h"
#include "model/learning/run_progress.h"
#include "model/learning/tensors.h"
#include "model/learning/training_data.h"

namespace maneuver::learning {

// Both baselines, one after the other, each a phase of the run: the model's examples, inputs,
// variations, batches, epochs, schedule, weight decay and dropout of its joint phase, as many
// anchors as it has actions, and fresh weights of the same backbone and classifier. Their random
// numbers are their own, so that the model is the same with and without them.
class AnchorLearner {
 public:
  // `settings` are complete. `data`, `progress` and `model` must outlive the learner.
  //   model: learned and calibrated; checkpoints hold it too
  AnchorLearner(const v1::TrainingSettings& settings, const TrainingData& data, at::Device device,
                int threads, std::function<bool()> stopped, RunProgress& progress,
                const Networks& model);

  // Puts the phases of the baselines before "export" in the plan of a run.
  static void AddPhases(const v1::TrainingSettings& settings, int64_t training_examples,
                        std::vector<RunProgress::Phase>* plan);

  // Writes checkpoints to `folder`, which must outlive the learner, and goes on from its latest one
  // if that is of these phases. It is of the same run: Learner has seen to that.
  void KeepCheckpoints(CheckpointFolder* folder);

  // CANCELLED if it was told to stop, ABORTED if the loss is no longer finite.
  absl::StatusOr<artifact::StoredBaselines> Learn();

 private:
  struct Baseline {
    std::string phase;
    at::Generator generator;
    AnchorNetworks networks;
  };

  Baseline MakeBaseline(bool regresses, const Anchors& anchors) const;
  absl::Status Train(Baseline& baseline);
  // Temperature, and covariance or its scale, as the model's (calibration.h).
  absl::Status Calibrate(Baseline& baseline);
  absl::Status KeepCheckpoint(const Baseline& baseline, int epochs, int64_t steps,
                              const std::string& epoch_random, const class AdamW& optimizer,
                              const class TermMeans& means);
  at::Tensor DrawEpoch(at::Generator& generator) const;

  const v1::TrainingSettings settings_;
  const TrainingData& data_;
  const at::Device device_;
  const int threads_;
  const std::function<bool()> stopped_;
  RunProgress& progress_;
  const Networks& model_;
  CheckpointFolder* checkpoints_ = nullptr;
  std::optional<Checkpoint> resumed_;  // until its phase takes it on
  std::vector<Baseline> baselines_;    // CoverNet-like, MultiPath-like
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_ANCHORS_ANCHOR_LEARNER_H_
