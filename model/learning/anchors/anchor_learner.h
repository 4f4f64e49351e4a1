// Trains the anchor baselines the way the model is trained.

#ifndef MANEUVER_MODEL_LEARNING_ANCHORS_ANCHOR_LEARNER_H_
#define MANEUVER_MODEL_LEARNING_ANCHORS_ANCHOR_LEARNER_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/artifact/anchor_baselines.h"
#include "model/learning/anchors/anchor_networks.h"
#include "model/learning/calibration.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"
#include "model/learning/phases/rehearsal.h"
#include "model/learning/run_examples.h"
#include "model/learning/tensors.h"
#include "model/learning/training_progress.h"

namespace maneuver::learning {

// Trains both baselines, one after the other, each as a phase of the run. They use the settings of
// the model's joint phase (examples, inputs, variations, batches, epochs, schedule, weight decay,
// dropout), as many anchors as the model has actions, and fresh weights of the same backbone and
// classifier. They draw from their own random numbers, so the model is the same with and without
// them.
class AnchorLearner {
 public:
  // Both arguments must outlive the learner.
  AnchorLearner(LearningState& model, EpochLoop& loop);

  // Puts the phases of the baselines before "export" in the plan of a run.
  static void AddPhases(const v1::TrainingSettings& settings, const RunExamples& examples,
                        std::vector<TrainingProgress::Phase>* plan);

  // Returns the phases of the baselines, for a rehearsal before them. They learn on fresh weights.
  // The learner must outlive them.
  LaterPhases Rehearsed() const;

  // Trains and calibrates both baselines. The model must be learned and calibrated: checkpoints
  // also hold it, so a run that is resumed in the baselines does not learn it again. Errors: those
  // of EpochLoop::Run; CANCELLED if it was asked to stop.
  absl::StatusOr<artifact::StoredBaselines> Learn();

  // Returns both baselines as they are: on fresh weights until Learn.
  artifact::StoredBaselines Export() const;

 private:
  struct Baseline {
    std::string phase;
    at::Generator generator;
    AnchorNetworks networks;
  };

  Baseline MakeBaseline(bool regresses) const;
  absl::Status Train(Baseline& baseline, EpochLoop& loop) const;
  // Calibrates the temperature, and the covariance or its scale, as for the model (calibration.h).
  //   count: called after each step
  absl::Status Calibrate(const CalibrationExamples& most, Baseline& baseline,
                         const CountCalibrationStep& count) const;

  LearningState& model_;
  EpochLoop& loop_;
  const Anchors anchors_;
  std::vector<Baseline> baselines_;  // CoverNet-like, MultiPath-like
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_ANCHORS_ANCHOR_LEARNER_H_
