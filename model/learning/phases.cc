// What is done in each phase of a Learner.

#include <ATen/Parallel.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "model/learning/calibration.h"
#include "model/learning/epoch_size.h"
#include "model/learning/learner.h"
#include "model/learning/raster_loader.h"

namespace maneuver::learning {
namespace {

using Part = Networks::Part;

constexpr int64_t kWarmUp = 100;            // steps
constexpr int64_t kMostClustered = 16'384;  // examples

// One thread while it lives: layers over a batch of trajectories are over before a second thread
// has woken, and on a busy machine threads that wait for each other cost several times the work.
class OneThread {
 public:
  OneThread() : before_(at::get_num_threads()) { at::set_num_threads(1); }
  ~OneThread() { at::set_num_threads(before_); }
  OneThread(const OneThread&) = delete;
  OneThread& operator=(const OneThread&) = delete;

 private:
  const int before_;
};

}  // namespace
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

absl::Status Learner::TrainOnTrajectories(const std::string& phase, int epochs,
                                          const std::vector<Group>& groups, const BatchLoss& loss,
                                          const std::function<v1::EpochReport(TermMeans)>& report) {
  const OneThread one_thread;
  const int64_t batch_size = settings_.optimization().batch_size() * kTrajectoryBatchFactor;
  const int64_t examples = EpochExamples(settings_, trajectories_.size(0));
  const int64_t epoch_steps = StepsOfEpoch(examples, batch_size);
  AdamW optimizer;
  for (const Group& group : groups) {
    optimizer.Add(networks_.Parameters(group.part), group.rate,
                  settings_.optimization().weight_decay());
  }
  TermMeans means;
  for (Position now = BeginPhase(phase, epoch_steps, &optimizer, &means); now.epochs < epochs;
       now = {now.epochs + 1, 0, false}) {
    const at::Tensor order = BeginEpoch(now);
    for (; now.steps < epoch_steps; ++now.steps) {
      const absl::Status kept = KeepCheckpoint(phase, now, optimizer, means);
      if (!kept.ok()) return kept;
      const at::Tensor batch =
          order.slice(0, now.steps * batch_size, std::min(examples, (now.steps + 1) * batch_size));
      const int64_t step = now.epochs * epoch_steps + now.steps;
      const at::Tensor x = Vary(trajectories_.index_select(0, batch));
      const at::Tensor value = loss(x, &means);
      means.Add("loss", value, x.size(0));
      const absl::Status status =
          TakeStep(value, LearningRateShare(step, kWarmUp, epochs * epoch_steps), &optimizer);
      if (!status.ok()) return status;
      progress_.Step(x.size(0));
    }
    progress_.EndEpoch(report(std::exchange(means, {})));
  }
  optimizer.ZeroGradients();
  return absl::OkStatus();
}

absl::Status Learner::Pretrain() {
  const double rate = settings_.optimization().learning_rate();
  const Gaussian prior = StandardNormal(settings_.model().latent_dimensions(), networks_.device());
  const double stddev = settings_.model().decoder_stddev();
  return TrainOnTrajectories(
      "pretrain", settings_.optimization().pretraining_epochs(),
      {{Part::kTrajectoryEncoder, rate}, {Part::kDecoder, rate}},
      [&](const at::Tensor& x, TermMeans* means) {
        const Gaussian q_z = networks_.EncodeTrajectories(x);
        const at::Tensor z = Sample(q_z, Noise(q_z.mean.sizes()));
        const at::Tensor reconstruction = LogLikelihood(x, networks_.Decode(z), stddev);
        const at::Tensor divergence = Divergence(q_z, prior);
        means->Add("reconstruction", reconstruction, x.size(0));
        means->Add("latent_divergence", divergence, x.size(0));
        return (divergence - reconstruction).mean();
      },
      [this](TermMeans means) {
        v1::EpochReport report;
        means.Write(report.mutable_training());
        ValidateBase(networks_, validation_trajectories_, /*has_mixture=*/false, &report);
        return report;
      });
}

EncodedExamples Learner::EncodeForPlacement(std::vector<int>* labels) {
  at::NoGradGuard no_grad;
  const int64_t count = std::min(trajectories_.size(0), kMostClustered);
  const at::Tensor drawn =
      at::arange(count, at::kLong).mul_(trajectories_.size(0)).floor_divide_(count);
  at::Tensor placed = trajectories_.index_select(0, drawn);
  labels->clear();
  if (!data_.labels.empty()) {
    for (int64_t i = 0; i < count; ++i) {
      labels->push_back(data_.labels[static_cast<size_t>(drawn[i].item<int64_t>())]);
    }
  }
  // Where left and right are swapped at random, clusters are of both sides.
  if (settings_.augmentation().mirror()) {
    at::Tensor mirrored = placed.clone().view({count, -1, 2});
    mirrored.select(2, 1).neg_();
    placed = at::cat({placed, mirrored.flatten(1)});
    // A mirrored left turn is not one.
    labels->resize(labels->empty() ? 0 : static_cast<size_t>(placed.size(0)), -1);
  }
  const Gaussian q_z = networks_.EncodeTrajectories(placed.to(networks_.device()));
  return {placed, {q_z.mean.cpu(), q_z.log_variance.cpu()}};
}

absl::Status Learner::PlaceMixture() {
  if (stopped_()) return absl::CancelledError("training was stopped");
  const v1::OptimizationSettings& optimization = settings_.optimization();
  std::vector<int> labels;
  const EncodedExamples examples = EncodeForPlacement(&labels);
  const auto place = [&](uint64_t seed) {
    at::NoGradGuard no_grad;
    const PlacedMixture placed = PlaceLabelledMixture(
        optimization.mixture_placement(), examples, labels,
        static_cast<int>(data_.label_names.size()), settings_.model().actions(), seed);
    networks_["mixture.mean"].copy_(placed.components.mean);
    networks_["mixture.log_variance"].copy_(placed.components.log_variance);
    networks_["mixture.log_weight"].copy_(placed.log_weights);
  };
  const uint64_t seed = static_cast<uint64_t>(settings_.seed());
  if (optimization.placements() == 1) {
    place(seed);
    return absl::OkStatus();
  }
  const Networks::Snapshot pretrained = networks_.Save();
  Networks::Snapshot best;
  double best_loss = HUGE_VAL;
  progress_.BeginPhase("place");
  for (int i = 0; i < optimization.placements(); ++i) {
    networks_.Restore(pretrained);
    place(seed + static_cast<uint64_t>(i));
    double loss = HUGE_VAL;
    const absl::Status status = TrainMixtureFor("", kPlacementEpochs, &loss);
    if (!status.ok()) return status;
    if (i == 0 || loss < best_loss) {
      best_loss = loss;
      best = networks_.Save();
    }
  }
  networks_.Restore(best);
  return absl::OkStatus();
}

absl::Status Learner::TrainMixtureFor(const std::string& phase, int epochs,
                                      double* validation_loss) {
  const double rate = settings_.optimization().learning_rate();
  return TrainOnTrajectories(
      phase, epochs,
      {{Part::kTrajectoryEncoder, rate}, {Part::kDecoder, rate}, {Part::kMixture, rate}},
      [this](const at::Tensor& x, TermMeans* means) {
        const BoundTerms terms = BaseBound(ApplyBase(networks_, {x, {}, {}}, NoiseDrawn()));
        means->Add(terms);
        return Loss(terms, {});
      },
      [this, validation_loss](TermMeans means) {
        v1::EpochReport report;
        means.Write(report.mutable_training());
        ValidateBase(networks_, validation_trajectories_, /*has_mixture=*/true, &report);
        // Without held-out examples, that of training.
        const auto& terms = report.validation().empty() ? report.training() : report.validation();
        *validation_loss = terms.at("loss");
        return report;
      });
}

absl::Status Learner::TrainMixture() {
  double ignored = 0.0;
  return TrainMixtureFor("mixture", settings_.optimization().mixture_epochs(), &ignored);
}

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
  const BoundWeights weights = Weights(optimization);
  const uint64_t seed = static_cast<uint64_t>(settings_.seed());
  TermMeans means;
  for (Position now = BeginPhase(phase, epoch_steps, &optimizer, &means); now.epochs < epochs;
       now = {now.epochs + 1, 0, false}) {
    const int epoch = now.epochs + 1;
    const at::Tensor order = BeginEpoch(now);
    std::vector<RasterLoader::Item> items;
    for (int64_t i = now.steps * batch_size; i < examples; ++i) {
      const int64_t example = order.data_ptr<int64_t>()[i];
      items.push_back({example, DrawVariation(settings_.augmentation(), raster.history_frames(),
                                              seed, epoch, example)});
    }
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
      const BoundTerms terms = SceneBound(networks_, objective, optimization, scenes, NoiseDrawn());
      const at::Tensor loss = Loss(terms, weights);
      means.Add(terms);
      means.Add("loss", loss, scenes.trajectories.size(0));
      const int64_t step = now.epochs * epoch_steps + now.steps;
      const absl::Status status =
          TakeStep(loss, LearningRateShare(step, kWarmUp, epochs * epoch_steps), &optimizer);
      if (!status.ok()) return status;
      ++now.steps;
      progress_.Step(scenes.trajectories.size(0));
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
  if (settings_.model().objective() == v1::OBJECTIVE_DUAL) {
    return TrainOnScenes("dual", optimization.dual_epochs(), v1::OBJECTIVE_DUAL,
                         {{Part::kScenarioEncoder, optimization.learning_rate()}});
  }
  if (settings_.model().objective() == v1::OBJECTIVE_BASE) networks_.SilenceScenarioEncoders();
  return absl::OkStatus();
}

absl::Status Learner::Calibrate() {
  if (resumed_) return absl::OkStatus();  // by a later phase: done before it
  progress_.BeginPhase("calibrate");
  progress_.BeginEpoch(1);
  return CalibrateModel(networks_, data_, settings_.optimization(), threads_, generator_, stopped_,
                        [this](int64_t examples) { progress_.Step(examples); });
}

}  // namespace maneuver::learning
