#include "model/learning/learner.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <span>
#include <utility>

#include "model/learning/calibration.h"
#include "model/learning/epoch_size.h"
#include "model/learning/example_order.h"
#include "model/learning/run_state.h"

namespace maneuver::learning {

namespace {

double CountTracks(std::span<const data::Example> examples) {
  std::set<std::pair<int, int64_t>> tracks;
  for (const data::Example& example : examples) {
    tracks.emplace(example.recording, example.target_id);
  }
  return static_cast<double>(tracks.size());
}

}  // namespace

std::vector<RunProgress::Phase> Learner::Plan(const v1::TrainingSettings& settings,
                                              int64_t training_examples, bool started) {
  const v1::OptimizationSettings& optimization = settings.optimization();
  const int64_t batch = optimization.batch_size();
  const int64_t examples = EpochExamples(settings, training_examples);
  const int64_t short_epoch = StepsOfEpoch(examples, batch * kTrajectoryBatchFactor);
  const int64_t long_epoch = StepsOfEpoch(examples, batch);
  const int64_t placements = optimization.placements() > 1 ? optimization.placements() : 0;
  const int posterior_epochs =
      settings.model().objective() == v1::OBJECTIVE_BASE ? 0 : optimization.posterior_epochs();
  const int covariance_epochs =
      settings.model().has_scene_covariance() ? optimization.covariance_epochs() : 0;
  // Costs of a step relative to one of pretraining, for the compact preset.
  std::vector<RunProgress::Phase> plan = {{"load", 1, 1, 1.0}};
  if (!started) {
    plan.insert(plan.end(),
                {{"pretrain", optimization.pretraining_epochs(),
                  optimization.pretraining_epochs() * short_epoch, 1.0},
                 {"place", kPlacementEpochs, placements * kPlacementEpochs * short_epoch, 1.3},
                 {"mixture", optimization.mixture_epochs(),
                  optimization.mixture_epochs() * short_epoch, 1.3}});
  }
  plan.insert(plan.end(), {{"joint", optimization.joint_epochs(),
                            optimization.joint_epochs() * long_epoch, 30.0},
                           {"posterior", posterior_epochs, posterior_epochs * long_epoch, 20.0},
                           {"covariance", covariance_epochs, covariance_epochs * long_epoch, 10.0},
                           {"calibrate", 1, CalibrationSteps(training_examples), 15.0},
                           {"export", 1, 1, 1.0},
                           {"evaluate", 1, 100, 7.0}});
  return plan;
}

Learner::Learner(const v1::TrainingSettings& settings, const TrainingData& data, at::Device device,
                 int threads, std::function<bool()> stopped, RunProgress& progress)
    : settings_(settings),
      data_(data),
      threads_(threads),
      stopped_(std::move(stopped)),
      progress_(progress),
      generator_(MakeGenerator(static_cast<uint64_t>(settings.seed()))),
      networks_(settings.model(), device, generator_),
      observations_(CountTracks(data.training.examples)),
      trajectories_(Trajectories(data.training.examples)),
      validation_trajectories_(Trajectories(data.validation.examples)) {
  networks_.Standardize(trajectories_, settings.augmentation().mirror());
}

void Learner::StartFrom(const artifact::TensorMap& weights, const std::string& sha256) {
  networks_.Import(weights);
  start_weights_sha256_ = sha256;
}

absl::Status Learner::KeepCheckpoints(CheckpointFolder* folder) {
  checkpoints_ = folder;
  resumed_ = folder->ReadLatest();
  if (!resumed_) return absl::OkStatus();
  if (resumed_->settings() != RunSettings(settings_) ||
      resumed_->training_examples() != trajectories_.size(0) ||
      resumed_->start_weights_sha256() != start_weights_sha256_) {
    return absl::FailedPreconditionError(
        "the folder of checkpoints is of a run with other settings, other data or another start; "
        "name another folder, or empty this one to start anew");
  }
  RestoreNetworks(*resumed_, &networks_);
  if (resumed_->has_centers()) centers_ = RestoreTensor(resumed_->centers());
  return absl::OkStatus();
}

absl::Status Learner::Learn() {
  struct Stage {
    const char* phase;
    absl::Status (Learner::*run)();
  };
  constexpr Stage kStages[] = {{"pretrain", &Learner::Pretrain},
                               {"place", &Learner::PlaceMixture},
                               {"mixture", &Learner::TrainMixture},
                               {"joint", &Learner::TrainJointly},
                               {"posterior", &Learner::TrainScenarioEncoders},
                               {"covariance", &Learner::TrainCovariance}};
  const size_t first =
      start_weights_sha256_.empty() ? 0 : 3;  // what was started from has a mixture
  for (const Stage& stage : std::span(kStages).subspan(first)) {
    // Until its phase has taken the checkpoint on, all phases before it are over.
    if (resumed_ && resumed_->phase() != stage.phase) continue;
    const absl::Status status = (this->*stage.run)();
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

Learner::Position Learner::BeginPhase(const std::string& phase, int64_t epoch_steps,
                                      AdamW* optimizer, TermMeans* means) {
  if (!phase.empty()) progress_.BeginPhase(phase);
  if (!resumed_ || resumed_->phase() != phase) return {};
  RestoreOptimizer(*resumed_, optimizer);
  RestoreRandomState(resumed_->random(), &generator_);
  epoch_random_ = resumed_->epoch_random();
  means->Restore(*resumed_);
  const Position position{resumed_->epochs(), resumed_->steps(), /*order_drawn=*/true};
  progress_.Resume(position.epochs * epoch_steps + position.steps);
  resumed_.reset();
  return position;
}

at::Tensor Learner::BeginEpoch(const Position& position) {
  progress_.BeginEpoch(position.epochs + 1);
  if (!position.order_drawn) {
    epoch_random_ = RandomState(generator_);
    return DrawEpoch();
  }
  // In an epoch that has begun: its order is drawn once more, and then all is as it was.
  const std::string now = RandomState(generator_);
  RestoreRandomState(epoch_random_, &generator_);
  const at::Tensor order = DrawEpoch();
  RestoreRandomState(now, &generator_);
  return order;
}

absl::Status Learner::KeepCheckpoint(const std::string& phase, const Position& position,
                                     const AdamW& optimizer, const TermMeans& means) {
  const bool stops = stopped_();
  const absl::Status outcome =
      stops ? absl::CancelledError("training was stopped") : absl::OkStatus();
  if (checkpoints_ == nullptr || phase.empty()) return outcome;
  const bool due = stops || checkpoints_->IsDue();
  checkpoints_->CountStep();
  if (!due) return outcome;
  Checkpoint checkpoint;
  checkpoint.set_settings(RunSettings(settings_));
  checkpoint.set_training_examples(trajectories_.size(0));
  checkpoint.set_phase(phase);
  checkpoint.set_epochs(position.epochs);
  checkpoint.set_steps(position.steps);
  checkpoint.set_epoch_random(epoch_random_);
  checkpoint.set_random(RandomState(generator_));
  checkpoint.set_start_weights_sha256(start_weights_sha256_);
  StoreNetworks(networks_, &checkpoint);
  if (centers_.defined()) *checkpoint.mutable_centers() = StoreTensor(centers_);
  StoreOptimizer(optimizer, &checkpoint);
  means.Store(&checkpoint);
  const absl::Status written = checkpoints_->Write(checkpoint);
  return written.ok() ? outcome : written;
}

absl::Status Learner::TakeStep(const at::Tensor& loss, double rate_share, AdamW* optimizer) {
  const double value = loss.item<double>();
  if (!std::isfinite(value)) {
    return absl::AbortedError(
        "the loss is no longer finite; lower optimization.learning_rate, or look for positions in "
        "the data that are far off");
  }
  loss.backward();
  optimizer->Step(rate_share);
  return absl::OkStatus();
}

double Learner::WarmUpShare(int64_t step, int64_t steps) const {
  const double warm_up = settings_.optimization().divergence_warm_up() * static_cast<double>(steps);
  return warm_up > 0.0 ? std::min(1.0, static_cast<double>(step) / warm_up) : 1.0;
}

at::Tensor Learner::Noise(at::IntArrayRef shape) {
  return at::empty(shape, at::kFloat).normal_(0.0, 1.0, generator_).to(networks_.device());
}

NoiseSource Learner::NoiseDrawn() {
  return [this](at::IntArrayRef shape) { return Noise(shape); };
}

at::Tensor Learner::DrawEpoch() {
  return DrawExamples(DatasetSizes(data_), DatasetWeights(settings_),
                      EpochExamples(settings_, trajectories_.size(0)), generator_);
}

at::Tensor Learner::Vary(const at::Tensor& trajectories) {
  const v1::AugmentationSettings& augmentation = settings_.augmentation();
  const int64_t batch = trajectories.size(0);
  const at::Tensor scale =
      at::empty({batch, 1, 1}, at::kFloat)
          .uniform_(1.0 - augmentation.scale(), 1.0 + augmentation.scale(), generator_);
  at::Tensor varied = trajectories.view({batch, -1, 2}) * scale;
  if (augmentation.mirror()) {
    const at::Tensor side =
        at::empty({batch, 1}, at::kFloat).bernoulli_(0.5, generator_).mul_(2.0).sub_(1.0);
    varied.select(2, 1).mul_(side);
  }
  return varied.flatten(1).to(networks_.device());
}

}  // namespace maneuver::learning
