// The phases of learning, one after another on the same networks.

#ifndef MANEUVER_MODEL_LEARNING_LEARNER_H_
#define MANEUVER_MODEL_LEARNING_LEARNER_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/checkpoint.h"
#include "model/learning/mixture_placement.h"
#include "model/learning/networks.h"
#include "model/learning/objectives.h"
#include "model/learning/optimizer.h"
#include "model/learning/run_progress.h"
#include "model/learning/scene_bound.h"
#include "model/learning/tensors.h"
#include "model/learning/training_data.h"
#include "model/learning/validation.h"

namespace maneuver::learning {

// Learns by the phases below, in that order. Each ends with CANCELLED if it was told to stop, and
// with ABORTED if the loss is no longer finite.
class Learner {
 public:
  // `settings` are complete. `data` and `progress` must outlive the learner.
  //   threads: that draw rasters
  Learner(const v1::TrainingSettings& settings, const TrainingData& data, at::Device device,
          int threads, std::function<bool()> stopped, RunProgress& progress);

  // The plan of a run, for its RunProgress.
  //   started: from the weights of a model
  static std::vector<RunProgress::Phase> Plan(const v1::TrainingSettings& settings,
                                              int64_t training_examples, bool started = false);

  // Learning starts from these weights, of the same spec, in place of random ones: with the joint
  // phase. To be called first.
  //   sha256: of the weights, by which checkpoints of another run are known
  void StartFrom(const artifact::TensorMap& weights, const std::string& sha256);

  // Writes checkpoints to `folder`, which must outlive the learner, and goes on from its latest one
  // if there is one. FAILED_PRECONDITION if that is of another run.
  absl::Status KeepCheckpoints(CheckpointFolder* folder);

  // All phases up to calibration, from where the checkpoint left them.
  absl::Status Learn();

  // q(z|x) and p(x|z) as a plain variational autoencoder with p(z) = N(0, I).
  absl::Status Pretrain();
  // The mixture p(z|y), as the settings place it (mixture_placement.h); of several placements, the
  // one with the best held-out base bound after a few epochs.
  absl::Status PlaceMixture();
  // The base objective with a p(y) that knows no scenario.
  absl::Status TrainMixture();
  // The unified objective; or the base one, on which the dual builds.
  absl::Status TrainJointly();
  // q(z|y,s) alone, of a dual model; of a base model, it becomes the generic action.
  absl::Status TrainScenarioEncoders();
  // The covariance that the scene predicts, of a model that has one; all else is held fixed.
  absl::Status TrainCovariance();
  // What the predicted probabilities and covariances are worth: see calibration.h.
  absl::Status Calibrate();

  Networks& networks() { return networks_; }

 private:
  struct Group {
    Networks::Part part;
    double rate;
  };
  // When in a phase a batch is.
  struct Moment {
    int epoch = 0;                  // over
    double divergence_share = 1.0;  // of the weights of the divergences: WarmUpShare
  };
  // A batch's loss; its terms go to `means`.
  using BatchLoss = std::function<at::Tensor(const at::Tensor& trajectories, const Moment& moment,
                                             TermMeans* means)>;

  absl::Status TrainOnTrajectories(const std::string& phase, int epochs,
                                   const std::vector<Group>& groups, const BatchLoss& loss,
                                   const std::function<v1::EpochReport(TermMeans)>& report);
  absl::Status TrainMixtureFor(const std::string& phase, int epochs, double* validation_loss);
  // The loss of a batch of scenes; its terms go to `means`.
  using SceneLoss = std::function<at::Tensor(const SceneBatch& batch, const SceneTensors& scenes,
                                             const Moment& moment, TermMeans* means)>;
  // A phase on scenes: the parts that learn, and what is said of held-out examples after an epoch.
  absl::Status TrainOnScenes(const std::string& phase, int epochs, const std::vector<Group>& groups,
                             const SceneLoss& loss_of,
                             const std::function<void(v1::EpochReport*)>& validate);
  // Such a phase that maximises a bound.
  absl::Status TrainOnBound(const std::string& phase, int epochs, v1::Objective objective,
                            Learning learning, const std::vector<Group>& groups);
  // alpha_0 + N_k of the mixture, with a prior on its weights (dirichlet_weights.h). [K]
  at::Tensor WeightCounts() const;
  void FollowWeightCounts(const at::Tensor& responsibilities);
  // The cluster of each trajectory that the mixture was placed by. [B]
  at::Tensor ClustersOf(const at::Tensor& trajectories) const;
  // How far a phase is in its warm-up: 1 after it.
  double WarmUpShare(int64_t step, int64_t steps) const;
  // What mixtures are placed by, with the labels of each, if there are any.
  EncodedExamples EncodeForPlacement(std::vector<int>* labels);
  absl::Status TakeStep(const at::Tensor& loss, double rate_share, AdamW* optimizer);
  // Where a phase is.
  struct Position {
    int epochs = 0;     // over
    int64_t steps = 0;  // over, of the epoch after them
    // The order of that epoch was drawn before the checkpoint was written.
    bool order_drawn = false;
  };
  // Where a phase begins: at its start, or where the checkpoint says, whose state it then takes on.
  Position BeginPhase(const std::string& phase, int64_t epoch_steps, AdamW* optimizer,
                      TermMeans* means);
  // Begins an epoch, or goes on in the middle of one: the order of its examples.
  at::Tensor BeginEpoch(const Position& position);
  // Before each step: writes a checkpoint if one is due or the run is to stop, in which case it
  // returns CANCELLED.
  absl::Status KeepCheckpoint(const std::string& phase, const Position& position,
                              const AdamW& optimizer, const TermMeans& means);
  // The examples of an epoch in the order they are learned from: at most max_examples of them,
  // drawn anew each time.
  at::Tensor DrawEpoch();
  // Trajectories varied at random, [B, 2T].
  at::Tensor Vary(const at::Tensor& trajectories);
  at::Tensor Noise(at::IntArrayRef shape);
  NoiseSource NoiseDrawn();

  const v1::TrainingSettings settings_;
  const TrainingData& data_;
  const int threads_;
  const std::function<bool()> stopped_;
  RunProgress& progress_;
  at::Generator generator_;
  std::string epoch_random_;  // state of the generator when the epoch began
  CheckpointFolder* checkpoints_ = nullptr;
  std::optional<Checkpoint> resumed_;  // until its phase takes it on
  std::string start_weights_sha256_;   // empty: random weights
  Networks networks_;
  // Tracks that examples are of: windows of the same one repeat each other, and would overstate
  // what was seen.
  const double observations_;
  at::Tensor centers_;             // of the clusters that the mixture was placed by, if any
  const at::Tensor trajectories_;  // [N, 2T] metres, on the CPU
  const at::Tensor validation_trajectories_;  // [V, 2T]
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_LEARNER_H_
