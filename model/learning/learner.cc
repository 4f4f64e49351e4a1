#include "model/learning/learner.h"

#include <span>

#include "model/learning/calibration.h"
#include "model/learning/epoch_size.h"
#include "model/learning/phases/calibrate.h"
#include "model/learning/phases/covariance.h"
#include "model/learning/phases/joint.h"
#include "model/learning/phases/mixture.h"
#include "model/learning/phases/place.h"
#include "model/learning/phases/posterior.h"
#include "model/learning/phases/pretrain.h"

namespace maneuver::learning {
namespace {

struct LearningPhase {
  const char* name;
  absl::Status (*run)(LearningState&, EpochLoop&);
};

constexpr LearningPhase kLatentPhases[] = {
    {kPretrainPhase, Pretrain}, {kPlacePhase, PlaceMixture}, {kMixturePhase, TrainMixture}};
constexpr LearningPhase kScenePhases[] = {{kJointPhase, TrainJointly},
                                          {kPosteriorPhase, TrainScenarioEncoders},
                                          {kCovariancePhase, TrainCovariance}};
constexpr LearningPhase kLastPhases[] = {{kCalibratePhase, Calibrate}};

// Runs those of the phases that are not over.
absl::Status RunPhases(std::span<const LearningPhase> phases, LearningState& state,
                       EpochLoop& loop) {
  for (const LearningPhase& phase : phases) {
    if (loop.IsOver(phase.name)) continue;
    const absl::Status status = phase.run(state, loop);
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

}  // namespace

std::vector<RunProgress::Phase> Learner::Plan(const v1::TrainingSettings& settings,
                                              int64_t training_examples, int64_t examples_in_memory,
                                              bool started) {
  const v1::OptimizationSettings& optimization = settings.optimization();
  const int64_t batch = optimization.batch_size();
  const int64_t short_epoch =
      StepsOfEpoch(EpochExamples(settings, examples_in_memory), batch * kTrajectoryBatchFactor);
  const int64_t long_epoch = StepsOfEpoch(EpochExamples(settings, training_examples), batch);
  const int64_t placements = optimization.placements() > 1 ? optimization.placements() : 0;
  const int posterior_epochs =
      settings.model().objective() == v1::OBJECTIVE_BASE ? 0 : optimization.posterior_epochs();
  const int covariance_epochs =
      settings.model().has_scene_covariance() ? optimization.covariance_epochs() : 0;
  // Costs of a step relative to one of pretraining, for the compact preset.
  std::vector<RunProgress::Phase> plan = {{"load", 1, 1, 1.0}};
  if (!started) {
    plan.insert(plan.end(),
                {{kPretrainPhase, optimization.pretraining_epochs(),
                  optimization.pretraining_epochs() * short_epoch, 1.0},
                 {kPlacePhase, kPlacementEpochs, placements * kPlacementEpochs * short_epoch, 1.3},
                 {kMixturePhase, optimization.mixture_epochs(),
                  optimization.mixture_epochs() * short_epoch, 1.3}});
  }
  plan.insert(
      plan.end(),
      {{kJointPhase, optimization.joint_epochs(), optimization.joint_epochs() * long_epoch, 30.0},
       {kPosteriorPhase, posterior_epochs, posterior_epochs * long_epoch, 20.0},
       {kCovariancePhase, covariance_epochs, covariance_epochs * long_epoch, 10.0},
       {kCalibratePhase, 1, CalibrationSteps(examples_in_memory), 15.0},
       {"export", 1, 1, 1.0},
       {"evaluate", 1, 100, 7.0}});
  return plan;
}

Learner::Learner(const v1::TrainingSettings& settings, const TrainingData& data, at::Device device,
                 int threads, RankGroup& ranks, RunProgress& progress)
    : state_(settings, data, device, threads, [&ranks] { return ranks.StopRequested(); }),
      loop_(settings, data, ranks, progress) {}

void Learner::StartFrom(const artifact::TensorMap& weights, const std::string& sha256) {
  state_.networks.Import(weights);
  loop_.NameStart(sha256);
  has_start_ = true;
}

absl::Status Learner::KeepCheckpoints(CheckpointFolder* folder) {
  absl::Status status = loop_.KeepCheckpoints(folder);
  if (status.ok() && loop_.resumed() != nullptr) state_.Restore(*loop_.resumed());
  return status;
}

absl::Status Learner::Learn() {
  RankGroup& ranks = loop_.ranks();
  absl::Status status;
  if (!has_start_) {  // else the model that was started from has a mixture
    status = ranks.OnRankZero([this] { return RunPhases(kLatentPhases, state_, loop_); });
  }
  if (status.ok()) status = loop_.ShareResumedPhase();
  if (status.ok()) status = RunPhases(kScenePhases, state_, loop_);
  if (!status.ok()) return status;
  return ranks.OnRankZero([this] { return RunPhases(kLastPhases, state_, loop_); });
}

}  // namespace maneuver::learning
