// Trains the anchor baselines as the model was trained.

#ifndef MANEUVER_MODEL_LEARNING_ANCHORS_ANCHOR_LEARNER_H_
#define MANEUVER_MODEL_LEARNING_ANCHORS_ANCHOR_LEARNER_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/artifact/anchor_baselines.h"
#include "model/learning/anchors/anchor_networks.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"
#include "model/learning/run_progress.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Both baselines, one after the other, each a phase of the run: the model's examples, inputs,
// variations, batches, epochs, schedule, weight decay and dropout of its joint phase, as many
// anchors as it has actions, and fresh weights of the same backbone and classifier. Their random
// numbers are their own, so that the model is the same with and without them.
class AnchorLearner {
 public:
  // Both must outlive the learner. The model of `model` is learned and calibrated; checkpoints hold
  // it too, and the baselines are then resumed from them.
  AnchorLearner(LearningState& model, EpochLoop& loop);

  // Puts the phases of the baselines before "export" in the plan of a run.
  static void AddPhases(const v1::TrainingSettings& settings, int64_t training_examples,
                        std::vector<RunProgress::Phase>* plan);

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

  LearningState& model_;
  EpochLoop& loop_;
  std::vector<Baseline> baselines_;  // CoverNet-like, MultiPath-like
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_ANCHORS_ANCHOR_LEARNER_H_
