#include "model/learning/anchors/anchor_learner.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "model/learning/calibration.h"
#include "model/learning/covariance_fit.h"
#include "model/learning/epoch_size.h"
#include "model/learning/example_order.h"
#include "model/learning/optimizer.h"
#include "model/learning/predictions.h"
#include "model/learning/run_state.h"
#include "model/learning/scene_loader.h"
#include "model/learning/validation.h"

namespace maneuver::learning {
namespace {

constexpr char kPhases[][10] = {"covernet", "multipath"};
// As the model's calibration has them.
constexpr int64_t kMostCalibrated = 4096;  // examples
constexpr int64_t kMostChecked = 3072;
constexpr int64_t kFewestChecked = 100;
constexpr int64_t kCalibrationBatch = 64;

absl::Status Stopped() { return absl::CancelledError("training was stopped"); }

// At most `most` examples of a set, not varied; the covariances are the baseline's own.
Predictions PredictAll(AnchorNetworks& networks, const ExampleSet& set, int64_t most, int threads,
                       const std::function<bool()>& stopped) {
  at::NoGradGuard no_grad;
  std::vector<at::Tensor> trajectories, log_p, nearest, means, covariances;
  SceneLoader loader(networks.spec(), set, DrawItems(set, most), kCalibrationBatch, threads);
  while (std::optional<SceneLoader::Batch> batch = loader.Next()) {
    if (stopped()) return {};
    const at::Tensor x = batch->trajectories.to(networks.device());
    const AnchorPredictions predictions = networks.Predict(batch->scenes, {});
    trajectories.push_back(x);
    log_p.push_back(predictions.log_probabilities);
    nearest.push_back(NearestAnchor(networks.anchors(), x));
    means.push_back(predictions.mean);
    covariances.push_back(predictions.covariance);
  }
  if (trajectories.empty()) return {};
  const at::Tensor log_q = at::one_hot(at::cat(nearest), networks.anchors().size(0)).log();
  return {at::cat(trajectories), at::cat(log_p), log_q, at::cat(means), at::cat(covariances)};
}

}  // namespace

AnchorLearner::AnchorLearner(const v1::TrainingSettings& settings, const TrainingData& data,
                             at::Device device, int threads, std::function<bool()> stopped,
                             RunProgress& progress, const Networks& model)
    : settings_(settings),
      data_(data),
      device_(device),
      threads_(threads),
      stopped_(std::move(stopped)),
      progress_(progress),
      model_(model) {
  const Anchors anchors =
      PlaceAnchors(Trajectories(data.training.examples), settings.model().actions(),
                   settings.augmentation().mirror(), static_cast<uint64_t>(settings.seed()));
  for (const bool regresses : {false, true}) baselines_.push_back(MakeBaseline(regresses, anchors));
}

AnchorLearner::Baseline AnchorLearner::MakeBaseline(bool regresses, const Anchors& anchors) const {
  // Far from the seeds that people name runs by.
  at::Generator generator = MakeGenerator(static_cast<uint64_t>(settings_.seed()) ^
                                          (regresses ? 0x6d756c7469ULL : 0x636f766572ULL));
  AnchorNetworks networks(settings_.model(), anchors, regresses, device_, generator);
  return {kPhases[regresses ? 1 : 0], generator, std::move(networks)};
}

void AnchorLearner::AddPhases(const v1::TrainingSettings& settings, int64_t training_examples,
                              std::vector<RunProgress::Phase>* plan) {
  const v1::OptimizationSettings& optimization = settings.optimization();
  const int64_t steps =
      optimization.joint_epochs() *
      StepsOfEpoch(EpochExamples(settings, training_examples), optimization.batch_size());
  const auto place = std::find_if(plan->begin(), plan->end(),
                                  [](const auto& phase) { return phase.name == "export"; });
  plan->insert(place, {{kPhases[0], optimization.joint_epochs(), steps, 14.0},
                       {kPhases[1], optimization.joint_epochs(), steps, 24.0}});
}

void AnchorLearner::KeepCheckpoints(CheckpointFolder* folder) {
  checkpoints_ = folder;
  resumed_ = folder->ReadLatest();
  if (resumed_ && resumed_->phase() != kPhases[0] && resumed_->phase() != kPhases[1]) {
    resumed_.reset();
  }
  if (!resumed_) return;
  for (Baseline& each : baselines_) {
    each.networks.Restore(StoredNetworks(*resumed_, each.phase + "/"));
  }
}

absl::StatusOr<artifact::StoredBaselines> AnchorLearner::Learn() {
  for (Baseline& each : baselines_) {
    // Until its phase has taken the checkpoint on, those before it are over.
    if (resumed_ && resumed_->phase() != each.phase) continue;
    absl::Status status = Train(each);
    if (status.ok()) status = Calibrate(each);
    if (!status.ok()) return status;
  }
  return artifact::StoredBaselines{baselines_[0].networks.spec(), baselines_[0].networks.Export(),
                                   baselines_[1].networks.Export()};
}

at::Tensor AnchorLearner::DrawEpoch(at::Generator& generator) const {
  const int64_t examples = static_cast<int64_t>(data_.training.examples.size());
  return DrawExamples(DatasetSizes(data_), DatasetWeights(settings_),
                      EpochExamples(settings_, examples), generator);
}

absl::Status AnchorLearner::Train(Baseline& baseline) {
  const v1::OptimizationSettings& optimization = settings_.optimization();
  AnchorNetworks& networks = baseline.networks;
  AdamW optimizer;
  optimizer.Add(networks.Parameters(), optimization.learning_rate(), optimization.weight_decay());
  const Networks::Mode training{&baseline.generator, optimization.dropout()};
  const int64_t examples =
      EpochExamples(settings_, static_cast<int64_t>(data_.training.examples.size()));
  const int64_t batch_size = optimization.batch_size();
  const int64_t epoch_steps = StepsOfEpoch(examples, batch_size);
  const int64_t all_steps = optimization.joint_epochs() * epoch_steps;
  TermMeans means;
  std::string epoch_random;
  int epochs = 0;
  int64_t steps = 0;
  progress_.BeginPhase(baseline.phase);
  if (resumed_) {
    RestoreOptimizer(*resumed_, &optimizer);
    epoch_random = resumed_->epoch_random();
    means.Restore(*resumed_);
    epochs = resumed_->epochs();
    steps = resumed_->steps();
    // At the start of an epoch its order is drawn as if for the first time.
    RestoreRandomState(steps == 0 ? epoch_random : resumed_->random(), &baseline.generator);
    progress_.Resume(epochs * epoch_steps + steps);
    resumed_.reset();
  }
  for (; epochs < optimization.joint_epochs(); ++epochs, steps = 0) {
    progress_.BeginEpoch(epochs + 1);
    // In the middle of an epoch its order is drawn once more, and then all is as it was.
    const std::string now = RandomState(baseline.generator);
    if (steps == 0) epoch_random = now;
    RestoreRandomState(epoch_random, &baseline.generator);
    const at::Tensor order = DrawEpoch(baseline.generator);
    if (steps > 0) RestoreRandomState(now, &baseline.generator);
    std::vector<SceneLoader::Item> items =
        VariedItems(settings_, {order.data_ptr<int64_t>(), static_cast<size_t>(examples)},
                    steps * batch_size, epochs + 1);
    if (examples % batch_size == 1) items.pop_back();
    SceneLoader loader(networks.spec(), data_.training, std::move(items), batch_size, threads_);
    while (std::optional<SceneLoader::Batch> batch = loader.Next()) {
      if (stopped_()) return Stopped();
      const absl::Status kept =
          KeepCheckpoint(baseline, epochs, steps, epoch_random, optimizer, means);
      if (!kept.ok()) return kept;
      const at::Tensor x = batch->trajectories.to(device_);
      const AnchorPredictions predictions = networks.Predict(batch->scenes, training);
      const at::Tensor nearest = NearestAnchor(networks.anchors(), x);
      const at::Tensor losses = networks.regresses() ? MultiPathLoss(predictions, nearest, x)
                                                     : ClassifierLoss(predictions, nearest);
      means.Add("loss", losses, x.size(0));
      means.Add("action_divergence", ClassifierLoss(predictions, nearest), x.size(0));
      const at::Tensor loss = losses.mean();
      if (!std::isfinite(loss.item<double>())) {
        return absl::AbortedError("the loss of the baseline " + baseline.phase +
                                  " is no longer finite; lower optimization.learning_rate");
      }
      loss.backward();
      optimizer.Step(LearningRateShare(epochs * epoch_steps + steps, kWarmUpSteps, all_steps));
      ++steps;
      progress_.Step(x.size(0), batch->waited);
    }
    v1::EpochReport report;
    std::exchange(means, {}).Write(report.mutable_training());
    progress_.EndEpoch(report);
  }
  optimizer.ZeroGradients();
  return absl::OkStatus();
}

absl::Status AnchorLearner::Calibrate(Baseline& baseline) {
  const v1::OptimizationSettings& optimization = settings_.optimization();
  AnchorNetworks& networks = baseline.networks;
  Predictions held_out = PredictAll(networks, data_.validation, kMostChecked, threads_, stopped_);
  if (stopped_()) return Stopped();
  const bool has_held_out =
      held_out.trajectories.defined() && held_out.trajectories.size(0) >= kFewestChecked;
  if (has_held_out && optimization.calibrate_probabilities()) {
    networks.SetTemperature(
        FitTemperature(held_out.log_probabilities, held_out.log_responsibilities));
    // Once more, with the temperature in it.
    held_out = PredictAll(networks, data_.validation, kMostChecked, threads_, stopped_);
    if (stopped_()) return Stopped();
  }
  if (networks.regresses()) {
    if (!has_held_out) return absl::OkStatus();
    const at::Tensor own = held_out.covariance;
    held_out.covariance = at::zeros_like(own);
    networks.SetScale(FitCovarianceScale(held_out, own, /*fit_latent=*/false).factor);
    return absl::OkStatus();
  }
  Predictions training = PredictAll(networks, data_.training, kMostCalibrated, threads_, stopped_);
  if (stopped_()) return Stopped();
  training.covariance = at::zeros_like(training.covariance);
  at::Tensor covariance = FitDecoderCovariance(training, baseline.generator);
  if (has_held_out) {
    held_out.covariance = at::zeros_like(held_out.covariance);
    const CovarianceScale scale = FitCovarianceScale(held_out, covariance, /*fit_latent=*/false);
    covariance = covariance * scale.factor.view({1, -1, 1});
  }
  networks.SetCovariance(covariance);
  return absl::OkStatus();
}

absl::Status AnchorLearner::KeepCheckpoint(const Baseline& baseline, int epochs, int64_t steps,
                                           const std::string& epoch_random, const AdamW& optimizer,
                                           const TermMeans& means) {
  if (checkpoints_ == nullptr) return absl::OkStatus();
  const bool due = checkpoints_->IsDue();
  checkpoints_->CountStep();
  if (!due) return absl::OkStatus();
  Checkpoint checkpoint;
  checkpoint.set_settings(RunSettings(settings_));
  checkpoint.set_training_examples(static_cast<int64_t>(data_.training.examples.size()));
  checkpoint.set_phase(baseline.phase);
  checkpoint.set_epochs(epochs);
  checkpoint.set_steps(steps);
  checkpoint.set_epoch_random(epoch_random);
  checkpoint.set_random(RandomState(baseline.generator));
  StoreNetworks(model_, &checkpoint);
  for (const Baseline& each : baselines_) {
    StoreSnapshot(each.networks.Save(), each.phase + "/", &checkpoint);
  }
  StoreOptimizer(optimizer, &checkpoint);
  means.Store(&checkpoint);
  return checkpoints_->Write(checkpoint);
}

}  // namespace maneuver::learning
