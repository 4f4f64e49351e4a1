#include "model/learning/learner.h"

#include <algorithm>
#include <optional>
#include <span>

#include "model/learning/calibration.h"
#include "model/learning/epoch_size.h"
#include "model/learning/export.h"
#include "model/learning/phases/calibrate.h"
#include "model/learning/phases/covariance.h"
#include "model/learning/phases/joint.h"
#include "model/learning/phases/mixture.h"
#include "model/learning/phases/place.h"
#include "model/learning/phases/posterior.h"
#include "model/learning/phases/pretrain.h"
#include "model/learning/predictions.h"

namespace maneuver::learning {
namespace {

struct LearningPhase {
  const char* name;
  absl::Status (*run)(LearningState&, EpochLoop&);
  // The batch of a step, in batches of the settings, if the phase is rehearsed; else 0.
  int64_t rehearsed_batch = 0;
};

constexpr LearningPhase kLatentPhases[] = {{kPretrainPhase, Pretrain, kTrajectoryBatchFactor},
                                           {kPlacePhase, ChoosePlacement},
                                           {kMixturePhase, TrainMixture}};
constexpr LearningPhase kScenePhases[] = {{kJointPhase, TrainJointly, 1},
                                          {kPosteriorPhase, TrainScenarioEncoders, 1},
                                          {kCovariancePhase, TrainCovariance, 1}};
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

std::vector<TrainingProgress::Phase> Learner::Plan(const v1::TrainingSettings& settings,
                                                   const RunExamples& examples, bool started) {
  const v1::OptimizationSettings& optimization = settings.optimization();
  const int64_t batch = optimization.batch_size();
  const int64_t short_epoch =
      StepsOfEpoch(EpochExamples(settings, examples.in_memory), batch * kTrajectoryBatchFactor);
  const int64_t long_epoch = StepsOfEpoch(EpochExamples(settings, examples.training), batch);
  const int64_t placements = optimization.placements() > 1 ? optimization.placements() : 0;
  const int posterior_epochs =
      settings.model().objective() == v1::OBJECTIVE_BASE ? 0 : optimization.posterior_epochs();
  const int covariance_epochs =
      settings.model().has_scene_covariance() ? optimization.covariance_epochs() : 0;
  const int64_t measured_examples = std::min(examples.held_out, kMostMeasured);
  // Costs of a step relative to one of pretraining, for the compact preset. Rehearse measures what
  // they are here.
  constexpr double kJointCost = 30.0;
  // Of an example, relative to learning from it in the joint phase.
  constexpr double kEncodeShare = 0.2;
  constexpr double kMeasureShare = 1.5;
  constexpr double kFinishShare = 0.2;
  const double example = kJointCost / static_cast<double>(batch);
  const double measured = example * static_cast<double>(measured_examples);
  std::vector<TrainingProgress::Phase> plan = {{"load", 1, 1, 1.0}};
  if (!started) {
    plan.insert(plan.end(),
                {{kPretrainPhase, optimization.pretraining_epochs(),
                  optimization.pretraining_epochs() * short_epoch, 1.0},
                 {kPlacePhase, kPlacementEpochs, placements * kPlacementEpochs * short_epoch, 1.4},
                 {kMixturePhase, optimization.mixture_epochs(),
                  optimization.mixture_epochs() * short_epoch, 1.4}});
  }
  plan.insert(plan.end(),
              {{kJointPhase, optimization.joint_epochs(), optimization.joint_epochs() * long_epoch,
                kJointCost},
               {kPosteriorPhase, posterior_epochs, posterior_epochs * long_epoch, 20.0},
               {kCovariancePhase, covariance_epochs, covariance_epochs * long_epoch, 10.0},
               CalibrationPhase(kCalibratePhase, PlanCalibration(settings, examples.Calibrated()),
                                kEncodeShare * example * kEncodedBatch),
               {kExportPhase, 1, 1, 1.0},
               {kEvaluatePhase,
                1,
                kEvaluateSteps,
                kMeasureShare * measured / kEvaluateSteps,
                {},
                {{1, kFinishShare * measured}}}});
  return plan;
}

Learner::Learner(const v1::TrainingSettings& settings, const TrainingData& data, at::Device device,
                 int threads, RankGroup& ranks, TrainingProgress& progress)
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

void Learner::Rehearse(const LaterPhases& later) {
  TrainingProgress& progress = loop_.progress();
  const int64_t batch = state_.settings.optimization().batch_size();
  MeasuredSteps measured;
  const auto rehearse = [&](const RehearsedPhase& phase) {
    if (phase.batch_size == 0 || loop_.IsOver(phase.name)) return;
    const auto planned =
        std::ranges::find(progress.plan(), phase.name, &TrainingProgress::Phase::name);
    if (planned == progress.plan().end()) return;
    const std::optional<double> seconds = RehearseStep(*planned, phase, state_, progress.clock());
    if (seconds) measured[phase.name] = {*seconds};
  };
  const auto rehearse_calibration = [&](const RehearsedCalibration& calibration) {
    const auto seconds = RehearseCalibration(calibration, state_, progress.clock());
    if (seconds) measured[calibration.name] = *seconds;
  };
  if (!has_start_) {
    for (const LearningPhase& each : kLatentPhases) {
      rehearse({each.name, batch * each.rehearsed_batch, each.run});
    }
  }
  for (const LearningPhase& each : kScenePhases) {
    rehearse({each.name, batch * each.rehearsed_batch, each.run, loop_.ranks().size()});
  }
  for (const RehearsedPhase& each : later.learned) rehearse(each);
  const CalibrationExamples calibrated =
      CountRunExamples(state_.settings.model(), state_.data).Calibrated();
  rehearse_calibration({kCalibratePhase, calibrated, PlanCalibration(state_.settings, calibrated),
                        [this](const CalibrationExamples& most, const CountCalibrationStep& count) {
                          return CalibrateBy(most, state_, count);
                        }});
  for (const RehearsedCalibration& each : later.calibrated) rehearse_calibration(each);
  if (later.rehearse_others && measured.contains(kJointPhase)) later.rehearse_others(&measured);
  progress.Replan(WithMeasuredSteps(progress.plan(), measured), measured.contains(kJointPhase));
}

absl::Status Learner::Learn(const LaterPhases& later) {
  RankGroup& ranks = loop_.ranks();
  absl::Status status = ranks.OnRankZero([&] {
    Rehearse(later);
    return absl::OkStatus();
  });
  if (status.ok() && !has_start_) {  // else the model that was started from has a mixture
    status = ranks.OnRankZero([this] { return RunPhases(kLatentPhases, state_, loop_); });
  }
  if (status.ok()) status = loop_.ShareResumedPhase();
  if (status.ok()) status = RunPhases(kScenePhases, state_, loop_);
  if (!status.ok()) return status;
  return ranks.OnRankZero([this] { return RunPhases(kLastPhases, state_, loop_); });
}

}  // namespace maneuver::learning
