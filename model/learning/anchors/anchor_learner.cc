#include "model/learning/anchors/anchor_learner.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "model/learning/calibration.h"
#include "model/learning/calibration_steps.h"
#include "model/learning/checkpoint_contents.h"
#include "model/learning/covariance_fit.h"
#include "model/learning/epoch_size.h"
#include "model/learning/example_order.h"
#include "model/learning/learner.h"
#include "model/learning/optimizer.h"
#include "model/learning/phases/calibrate.h"
#include "model/learning/phases/scene_batches.h"
#include "model/learning/predictions.h"
#include "model/learning/run_examples.h"
#include "model/learning/scene_loader.h"
#include "model/learning/validation.h"

namespace maneuver::learning {
namespace {

constexpr char kPhases[][10] = {"covernet", "multipath"};
constexpr char kCalibrations[][20] = {"calibrate covernet", "calibrate multipath"};

// Returns the steps of the calibration of a baseline.
CalibrationPlan PlanAnchorCalibration(const v1::TrainingSettings& settings, bool regresses,
                                      const CalibrationExamples& examples) {
  const bool has_held_out = examples.held_out >= kFewestHeldOut;
  const bool twice = has_held_out && settings.optimization().calibrate_probabilities();
  CalibrationPlan plan;
  PlannedSteps& encode = StepsOfKind(plan, CalibrationStep::kEncode);
  encode = {(twice ? 2 : 1) * BatchesOf(examples.held_out, kEncodedBatch), kEncodedBatch};
  if (has_held_out) {
    StepsOfKind(plan, CalibrationStep::kScale) = CovarianceScaleSteps(examples.held_out);
  }
  if (!regresses) {
    encode.count += BatchesOf(examples.training, kEncodedBatch);
    StepsOfKind(plan, CalibrationStep::kFit) = DecoderCovarianceSteps(examples.training);
  }
  return plan;
}

// Covariances of nothing, which take no memory.
at::Tensor NoCovariance(const at::Tensor& like) {
  return at::zeros({1}, like.options()).expand_as(like);
}

absl::Status Stopped() { return absl::CancelledError("training was stopped"); }

// At most `most` examples of a set, not varied; the covariances are the baseline's own.
//   count: called for each batch; the predictions keep it
Predictions PredictAll(AnchorNetworks& networks, const SceneSource& source, int64_t most,
                       const LearningState& model, const CountCalibrationStep& count) {
  at::NoGradGuard no_grad;
  std::vector<at::Tensor> trajectories, log_p, nearest, means, covariances;
  SceneLoader loader(networks.spec(), source, DrawItems(source.set(), most), kEncodedBatch,
                     model.threads);
  while (std::optional<SceneLoader::Batch> batch = loader.Next()) {
    if (model.stopped()) return {};
    const at::Tensor x = batch->trajectories.to(networks.device());
    const AnchorPredictions predictions = networks.Predict(batch->scenes, {});
    trajectories.push_back(x);
    log_p.push_back(predictions.log_probabilities);
    nearest.push_back(NearestAnchor(networks.anchors(), x));
    means.push_back(predictions.mean);
    covariances.push_back(predictions.covariance);
    count(CalibrationStep::kEncode, x.size(0));
  }
  if (trajectories.empty()) return {};
  const at::Tensor log_q = at::one_hot(at::cat(nearest), networks.anchors().size(0)).log();
  Predictions all = {at::cat(trajectories), at::cat(log_p), log_q, at::cat(means),
                     at::cat(covariances)};
  all.count = count;
  return all;
}

// Steps of a baseline over the examples of the model's joint phase.
class AnchorSteps final : public EpochSteps {
 public:
  AnchorSteps(AnchorNetworks& networks, at::Generator& generator, const LearningState& model)
      : networks_(networks),
        model_(model),
        batches_(networks.spec(), model),
        mode_{&generator, model.settings.optimization().dropout()} {}

  absl::Status BeginEpoch(const EpochStart& start) override { return batches_.BeginEpoch(start); }

  absl::StatusOr<BatchLoss> Next(const StepContext&, TermMeans* means) override {
    const absl::StatusOr<SceneBatches::LabelledBatch> next = batches_.Next();
    if (!next.ok()) return next.status();
    const SceneLoader::Batch& batch = next->batch;
    const at::Tensor x = batch.trajectories.to(model_.networks.device());
    const AnchorPredictions predictions = networks_.Predict(batch.scenes, mode_);
    const at::Tensor nearest = NearestAnchor(networks_.anchors(), x);
    const at::Tensor losses = networks_.regresses() ? MultiPathLoss(predictions, nearest, x)
                                                    : ClassifierLoss(predictions, nearest);
    means->Add("action_divergence", ClassifierLoss(predictions, nearest), x.size(0));
    return BatchLoss{losses.mean(), x.size(0), batch.waited};
  }

  void EndEpoch(v1::EpochReport*) override { batches_.EndEpoch(); }

 private:
  AnchorNetworks& networks_;
  const LearningState& model_;
  SceneBatches batches_;
  const Networks::Mode mode_;
};

}  // namespace

AnchorLearner::AnchorLearner(LearningState& model, EpochLoop& loop)
    : model_(model),
      loop_(loop),
      anchors_(PlaceAnchors(model.trajectories, model.settings.model().actions(),
                            model.settings.augmentation().mirror(),
                            static_cast<uint64_t>(model.settings.seed()))) {
  for (const bool regresses : {false, true}) baselines_.push_back(MakeBaseline(regresses));
  const Checkpoint* resumed = loop.resumed();
  // Checkpoints of the model's phases hold no baselines.
  if (resumed == nullptr ||
      std::ranges::find(baselines_, resumed->phase(), &Baseline::phase) == baselines_.end()) {
    return;
  }
  for (Baseline& each : baselines_) {
    each.networks.Restore(StoredNetworks(*resumed, each.phase + "/"));
  }
}

AnchorLearner::Baseline AnchorLearner::MakeBaseline(bool regresses) const {
  // Far from the seeds that people name runs by.
  at::Generator generator = MakeGenerator(static_cast<uint64_t>(model_.settings.seed()) ^
                                          (regresses ? 0x6d756c7469ULL : 0x636f766572ULL));
  AnchorNetworks networks(model_.settings.model(), anchors_, regresses, model_.networks.device(),
                          generator);
  return {kPhases[regresses ? 1 : 0], generator, std::move(networks)};
}

void AnchorLearner::AddPhases(const v1::TrainingSettings& settings, const RunExamples& examples,
                              std::vector<TrainingProgress::Phase>* plan) {
  const v1::OptimizationSettings& optimization = settings.optimization();
  const int64_t steps =
      optimization.joint_epochs() *
      StepsOfEpoch(EpochExamples(settings, examples.training), optimization.batch_size());
  // Encoding takes as long as for the model.
  const double encode =
      std::ranges::find(*plan, kCalibratePhase, &TrainingProgress::Phase::name)->cost;
  const auto place = std::ranges::find(*plan, kExportPhase, &TrainingProgress::Phase::name);
  const auto calibration = [&](bool regresses) {
    return CalibrationPhase(kCalibrations[regresses ? 1 : 0],
                            PlanAnchorCalibration(settings, regresses, examples.Calibrated()),
                            encode);
  };
  plan->insert(place, {{kPhases[0], optimization.joint_epochs(), steps, 14.0},
                       calibration(false),
                       {kPhases[1], optimization.joint_epochs(), steps, 24.0},
                       calibration(true)});
}

absl::StatusOr<artifact::StoredBaselines> AnchorLearner::Learn() {
  for (Baseline& each : baselines_) {
    if (loop_.IsOver(each.phase)) continue;
    absl::Status status = Train(each, loop_);
    if (!status.ok()) return status;
    loop_.progress().BeginPhase(kCalibrations[each.networks.regresses() ? 1 : 0]);
    status = Calibrate(CountRunExamples(model_.settings.model(), model_.data).Calibrated(), each,
                       StepsOf(loop_.progress()));
    if (!status.ok()) return status;
  }
  return Export();
}

artifact::StoredBaselines AnchorLearner::Export() const {
  return {baselines_[0].networks.spec(), baselines_[0].networks.Export(),
          baselines_[1].networks.Export()};
}

LaterPhases AnchorLearner::Rehearsed() const {
  LaterPhases phases;
  const CalibrationExamples calibrated =
      CountRunExamples(model_.settings.model(), model_.data).Calibrated();
  for (const bool regresses : {false, true}) {
    phases.learned.push_back({kPhases[regresses ? 1 : 0],
                              model_.settings.optimization().batch_size(),
                              [this, regresses](LearningState&, EpochLoop& loop) {
                                Baseline baseline = MakeBaseline(regresses);
                                return Train(baseline, loop);
                              }});
    phases.calibrated.push_back(
        {kCalibrations[regresses ? 1 : 0], calibrated,
         PlanAnchorCalibration(model_.settings, regresses, calibrated),
         [this, regresses](const CalibrationExamples& most, const CountCalibrationStep& count) {
           Baseline baseline = MakeBaseline(regresses);
           return Calibrate(most, baseline, count);
         }});
  }
  return phases;
}

absl::Status AnchorLearner::Train(Baseline& baseline, EpochLoop& loop) const {
  const v1::OptimizationSettings& optimization = model_.settings.optimization();
  AdamW optimizer;
  optimizer.Add(baseline.networks.Parameters(), optimization.learning_rate(),
                optimization.weight_decay());
  const auto store = [this](Checkpoint* checkpoint) {
    model_.Store(checkpoint);
    for (const Baseline& each : baselines_) {
      StoreSnapshot(each.networks.Save(), each.phase + "/", checkpoint);
    }
  };
  AnchorSteps steps(baseline.networks, baseline.generator, model_);
  return loop.Run({baseline.phase, optimization.joint_epochs(), optimization.batch_size(),
                   model_.data.TrainingExamples()},
                  {baseline.generator, optimizer, store}, steps);
}

absl::Status AnchorLearner::Calibrate(const CalibrationExamples& most, Baseline& baseline,
                                      const CountCalibrationStep& count) const {
  const v1::OptimizationSettings& optimization = model_.settings.optimization();
  AnchorNetworks& networks = baseline.networks;
  Predictions held_out = PredictAll(networks, model_.validation, most.held_out, model_, count);
  if (model_.stopped()) return Stopped();
  const bool has_held_out =
      held_out.trajectories.defined() && held_out.trajectories.size(0) >= kFewestHeldOut;
  if (has_held_out && optimization.calibrate_probabilities()) {
    networks.SetTemperature(
        FitTemperature(held_out.log_probabilities, held_out.log_responsibilities));
    // Once more, with the temperature in it.
    held_out = {};
    held_out = PredictAll(networks, model_.validation, most.held_out, model_, count);
    if (model_.stopped()) return Stopped();
  }
  if (networks.regresses()) {
    if (!has_held_out) return absl::OkStatus();
    const at::Tensor own = held_out.covariance;
    held_out.covariance = NoCovariance(own);
    networks.SetScale(FitCovarianceScale(held_out, own, /*fit_latent=*/false).factor);
    return absl::OkStatus();
  }
  Predictions training = PredictAll(networks, model_.training, most.training, model_, count);
  if (model_.stopped()) return Stopped();
  training.covariance = NoCovariance(training.covariance);
  at::Tensor covariance = FitDecoderCovariance(training, baseline.generator);
  if (has_held_out) {
    held_out.covariance = NoCovariance(held_out.covariance);
    const CovarianceScale scale = FitCovarianceScale(held_out, covariance, /*fit_latent=*/false);
    covariance = covariance * scale.factor.view({1, -1, 1});
  }
  networks.SetCovariance(covariance);
  return absl::OkStatus();
}

}  // namespace maneuver::learning
