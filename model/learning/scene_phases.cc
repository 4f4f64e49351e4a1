// The phases of a Learner that need scenes: joint, dual, calibrate.

#include <cmath>
#include <utility>

#include "model/learning/calibration.h"
#include "model/learning/epoch_size.h"
#include "model/learning/learner.h"
#include "model/learning/raster_loader.h"

namespace maneuver::learning {

using Part = Networks::Part;

absl::Status Learner::TrainOnScenes(const std::string& phase, int epochs, v1::Objective objective,
                                    const std::vector<Group>& groups) {
  const v1::OptimizationSettings& optimization = settings_.optimization();
  AdamW optimizer;
  bool backbone_learns = false;
  for (const Group& group : groups) {
    optimizer.Add(networks_.Parameters(group.part), group.rate, optimization.weight_decay());
    backbone_learns |= group.part == Part::kBackbone;
  }
  const Networks::Mode training{&generator_, optimization.dropout()};
  const v1::RasterSpec& raster = settings_.model().raster();
  const int64_t examples = EpochExamples(settings_, trajectories_.size(0));
  const int64_t batch_size = optimization.batch_size();
  const int64_t epoch_steps = StepsOfEpoch(examples, batch_size);
  TermMeans means;
  for (Position now = BeginPhase(phase, epoch_steps, &optimizer, &means); now.epochs < epochs;
       now = {now.epochs + 1, 0, false}) {
    const at::Tensor order = BeginEpoch(now);
    std::vector<RasterLoader::Item> items =
        VariedItems(settings_, {order.data_ptr<int64_t>(), static_cast<size_t>(examples)},
                    now.steps * batch_size, now.epochs + 1);
    if (examples % batch_size == 1) items.pop_back();
    RasterLoader loader(raster, data_.training, std::move(items), batch_size, threads_);
    while (std::optional<RasterLoader::Batch> batch = loader.Next()) {
      const absl::Status kept = KeepCheckpoint(phase, now, optimizer, means);
      if (!kept.ok()) return kept;
      SceneBatch scenes;
      scenes.trajectories = VariedTrajectories(data_.training, *batch).to(networks_.device());
      scenes.labels = BatchLabels(data_.labels, *batch);
      const at::Tensor motions = VariedMotions(data_.training, *batch);
      if (backbone_learns) {
        scenes.features = networks_.EncodeScenes(RasterTensor(raster, *batch), motions, training);
      } else {
        at::NoGradGuard no_grad;
        scenes.features = networks_.EncodeScenes(RasterTensor(raster, *batch), motions, {});
      }
      const BoundTerms terms =
          SceneBound(networks_, objective, backbone_learns ? Learning::kAll : Learning::kPosterior,
                     optimization, scenes, NoiseDrawn());
      const int64_t step = now.epochs * epoch_steps + now.steps;
      const at::Tensor loss =
          Loss(terms, Weights(optimization, WarmUpShare(step, epochs * epoch_steps)));
      means.Add(terms);
      means.Add("loss", loss, scenes.trajectories.size(0));
      const absl::Status status =
          TakeStep(loss, LearningRateShare(step, kWarmUpSteps, epochs * epoch_steps), &optimizer);
      if (!status.ok()) return status;
      ++now.steps;
      progress_.Step(scenes.trajectories.size(0), batch->waited);
    }
    v1::EpochReport report;
    std::exchange(means, {}).Write(report.mutable_training());
    ValidateScenes(networks_, data_.validation, objective, optimization, threads_, stopped_,
                   &report);
    progress_.EndEpoch(report);
  }
  optimizer.ZeroGradients();
  return absl::OkStatus();
}

absl::Status Learner::TrainJointly() {
  const v1::OptimizationSettings& optimization = settings_.optimization();
  const double rate = optimization.learning_rate();
  const double latent_rate = rate * optimization.latent_learning_rate_share();
  const bool unified = settings_.model().objective() == v1::OBJECTIVE_UNIFIED;
  std::vector<Group> groups = {{Part::kBackbone, rate},
                               {Part::kActions, rate},
                               {Part::kTrajectoryEncoder, latent_rate},
                               {Part::kDecoder, latent_rate},
                               {Part::kMixture, latent_rate}};
  if (unified) groups.push_back({Part::kScenarioEncoder, rate});
  return TrainOnScenes("joint", optimization.joint_epochs(),
                       unified ? v1::OBJECTIVE_UNIFIED : v1::OBJECTIVE_BASE, groups);
}

absl::Status Learner::TrainScenarioEncoders() {
  const v1::OptimizationSettings& optimization = settings_.optimization();
  if (settings_.model().objective() == v1::OBJECTIVE_BASE) {
    networks_.SilenceScenarioEncoders();
    return absl::OkStatus();
  }
  return TrainOnScenes("posterior", optimization.posterior_epochs(), settings_.model().objective(),
                       {{Part::kScenarioEncoder, optimization.learning_rate()}});
}

absl::Status Learner::Calibrate() {
  if (resumed_) return absl::OkStatus();  // by a later phase: done before it
  progress_.BeginPhase("calibrate");
  progress_.BeginEpoch(1);
  return CalibrateModel(networks_, data_, settings_.optimization(), threads_, generator_, stopped_,
                        [this](int64_t examples) { progress_.Step(examples); });
}

}  // namespace maneuver::learning
