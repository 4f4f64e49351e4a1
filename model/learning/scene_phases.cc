// The phases of a Learner that need scenes: joint, dual, calibrate.

#include <cmath>
#include <utility>

#include "model/learning/calibration.h"
#include "model/learning/epoch_size.h"
#include "model/learning/learner.h"
#include "model/learning/scene_covariance.h"
#include "model/learning/scene_loader.h"

namespace maneuver::learning {

using Part = Networks::Part;

absl::Status Learner::TrainOnScenes(const std::string& phase, int epochs,
                                    const std::vector<Group>& groups, const SceneLoss& loss_of,
                                    const std::function<void(v1::EpochReport*)>& validate) {
  const v1::OptimizationSettings& optimization = settings_.optimization();
  AdamW optimizer;
  bool scene_learns = false;
  for (const Group& group : groups) {
    optimizer.Add(networks_.Parameters(group.part), group.rate, optimization.weight_decay());
    scene_learns |= group.part == Part::kScene;
  }
  const Networks::Mode training{&generator_, optimization.dropout(),
                                optimization.geometry_dropout()};
  const int64_t examples = EpochExamples(settings_, trajectories_.size(0));
  const int64_t batch_size = optimization.batch_size();
  const int64_t epoch_steps = StepsOfEpoch(examples, batch_size);
  TermMeans means;
  for (Position now = BeginPhase(phase, epoch_steps, &optimizer, &means); now.epochs < epochs;
       now = {now.epochs + 1, 0, false}) {
    const at::Tensor order = BeginEpoch(now);
    std::vector<SceneLoader::Item> items =
        VariedItems(settings_, {order.data_ptr<int64_t>(), static_cast<size_t>(examples)},
                    now.steps * batch_size, now.epochs + 1);
    if (examples % batch_size == 1) items.pop_back();
    SceneLoader loader(settings_.model(), data_.training, std::move(items), batch_size, threads_);
    while (std::optional<SceneLoader::Batch> batch = loader.Next()) {
      const absl::Status kept = KeepCheckpoint(phase, now, optimizer, means);
      if (!kept.ok()) return kept;
      SceneBatch scenes;
      scenes.trajectories = batch->trajectories.to(networks_.device());
      scenes.labels = BatchLabels(data_.labels, *batch);
      if (scene_learns) {
        scenes.scenes = networks_.EncodeScenes(batch->scenes, training);
      } else {
        at::NoGradGuard no_grad;
        scenes.scenes = networks_.EncodeScenes(batch->scenes, {});
      }
      const int64_t step = now.epochs * epoch_steps + now.steps;
      const at::Tensor loss = loss_of(
          scenes, batch->scenes, {now.epochs, WarmUpShare(step, epochs * epoch_steps)}, &means);
      means.Add("loss", loss, scenes.trajectories.size(0));
      const absl::Status status =
          TakeStep(loss, LearningRateShare(step, kWarmUpSteps, epochs * epoch_steps), &optimizer);
      if (!status.ok()) return status;
      ++now.steps;
      progress_.Step(scenes.trajectories.size(0), batch->waited);
    }
    v1::EpochReport report;
    std::exchange(means, {}).Write(report.mutable_training());
    validate(&report);
    progress_.EndEpoch(report);
  }
  optimizer.ZeroGradients();
  return absl::OkStatus();
}

absl::Status Learner::TrainOnBound(const std::string& phase, int epochs, v1::Objective objective,
                                   Learning learning, const std::vector<Group>& groups) {
  const v1::OptimizationSettings& optimization = settings_.optimization();
  return TrainOnScenes(
      phase, epochs, groups,
      [&](const SceneBatch& batch, const SceneTensors&, const Moment& moment, TermMeans* means) {
        const BoundTerms terms =
            SceneBound(networks_, objective, learning, optimization, batch, NoiseDrawn());
        means->Add(terms);
        return Loss(terms, Weights(optimization, moment.divergence_share));
      },
      [&](v1::EpochReport* report) {
        ValidateScenes(networks_, data_.validation, objective, optimization, threads_, stopped_,
                       report);
      });
}

absl::Status Learner::TrainJointly() {
  const v1::OptimizationSettings& optimization = settings_.optimization();
  const double rate = optimization.learning_rate();
  const double latent_rate = rate * optimization.latent_learning_rate_share();
  const bool unified = settings_.model().objective() == v1::OBJECTIVE_UNIFIED;
  std::vector<Group> groups = {{Part::kScene, rate},
                               {Part::kActions, rate},
                               {Part::kTrajectoryEncoder, latent_rate},
                               {Part::kDecoder, latent_rate},
                               {Part::kMixture, latent_rate}};
  if (unified) groups.push_back({Part::kScenarioEncoder, rate});
  return TrainOnBound("joint", optimization.joint_epochs(),
                      unified ? v1::OBJECTIVE_UNIFIED : v1::OBJECTIVE_BASE, Learning::kAll, groups);
}

absl::Status Learner::TrainScenarioEncoders() {
  const v1::OptimizationSettings& optimization = settings_.optimization();
  if (settings_.model().objective() == v1::OBJECTIVE_BASE) {
    networks_.SilenceScenarioEncoders();
    return absl::OkStatus();
  }
  return TrainOnBound("posterior", optimization.posterior_epochs(), settings_.model().objective(),
                      Learning::kPosterior,
                      {{Part::kScenarioEncoder, optimization.learning_rate()}});
}

absl::Status Learner::TrainCovariance() {
  if (!settings_.model().has_scene_covariance()) return absl::OkStatus();
  constexpr double kRate = 4e-3;
  return TrainOnScenes(
      "covariance", settings_.optimization().covariance_epochs(), {{Part::kSceneCovariance, kRate}},
      [this](const SceneBatch& batch, const SceneTensors& scenes, const Moment&, TermMeans*) {
        return SceneCovarianceLoss(networks_, batch.scenes, batch.trajectories,
                                   scenes.references.to(networks_.device()))
            .mean();
      },
      [](v1::EpochReport*) {});
}

absl::Status Learner::Calibrate() {
  if (resumed_) return absl::OkStatus();  // by a later phase: done before it
  progress_.BeginPhase("calibrate");
  progress_.BeginEpoch(1);
  return CalibrateModel(networks_, data_, settings_.optimization(), threads_, generator_, stopped_,
                        [this](int64_t examples) { progress_.Step(examples); });
}

}  // namespace maneuver::learning
