// The phases of a Learner that need trajectories alone: pretrain, place, mixture.

#include <ATen/Parallel.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "model/artifact/model_spec.h"
#include "model/learning/dirichlet_weights.h"
#include "model/learning/epoch_size.h"
#include "model/learning/example_order.h"
#include "model/learning/learner.h"

namespace maneuver::learning {
namespace {

using Part = Networks::Part;

constexpr double kCountRate = 0.02;         // of the mixture's counts, a batch
constexpr int64_t kMostClustered = 16'384;  // examples

TrajectoryScale ScaleOf(const v1::TrainingSettings& settings) {
  return {artifact::WaypointTimes(settings.model().trajectory()).front(),
          settings.optimization().slow_speed()};
}

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
      const at::Tensor value =
          loss(x, {now.epochs, WarmUpShare(step, epochs * epoch_steps)}, &means);
      means.Add("loss", value, x.size(0));
      const absl::Status status =
          TakeStep(value, LearningRateShare(step, kWarmUpSteps, epochs * epoch_steps), &optimizer);
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
      [&](const at::Tensor& x, const Moment& moment, TermMeans* means) {
        const Gaussian q_z = networks_.EncodeTrajectories(x);
        const at::Tensor z = Sample(q_z, Noise(q_z.mean.sizes()));
        const at::Tensor reconstruction = LogLikelihood(x, networks_.Decode(z), stddev);
        const at::Tensor divergence = Divergence(q_z, prior);
        means->Add("reconstruction", reconstruction, x.size(0));
        means->Add("latent_divergence", divergence, x.size(0));
        return (moment.divergence_share * divergence - reconstruction).mean();
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
  const at::Tensor drawn = SpreadExamples(DatasetSizes(data_), DatasetWeights(settings_), count);
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
  return {placed, ScaleOf(settings_), {q_z.mean.cpu(), q_z.log_variance.cpu()}};
}

at::Tensor Learner::WeightCounts() const { return networks_["mixture.log_weight"].detach().exp(); }

void Learner::FollowWeightCounts(const at::Tensor& responsibilities) {
  at::NoGradGuard no_grad;
  networks_["mixture.log_weight"].copy_(
      FollowCounts(WeightCounts(), responsibilities, observations_,
                   settings_.optimization().weight_concentration(), kCountRate)
          .log());
}

at::Tensor Learner::ClustersOf(const at::Tensor& trajectories) const {
  return NearestClusters(settings_.optimization().mixture_placement(), centers_, trajectories.cpu(),
                         ScaleOf(settings_))
      .to(networks_.device());
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
    centers_ = placed.centers;
    networks_["mixture.mean"].copy_(placed.components.mean);
    networks_["mixture.log_variance"].copy_(placed.components.log_variance);
    networks_["mixture.log_weight"].copy_(placed.log_weights);
    if (optimization.weight_concentration() > 0.0) {
      // With a prior, the logarithms of its counts instead.
      networks_["mixture.log_weight"].add_(std::log(observations_));
    }
  };
  const uint64_t seed = static_cast<uint64_t>(settings_.seed());
  if (optimization.placements() == 1) {
    place(seed);
    return absl::OkStatus();
  }
  const Networks::Snapshot pretrained = networks_.Save();
  Networks::Snapshot best;
  at::Tensor best_centers;
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
      best_centers = centers_;
    }
  }
  networks_.Restore(best);
  centers_ = best_centers;
  return absl::OkStatus();
}

absl::Status Learner::TrainMixtureFor(const std::string& phase, int epochs,
                                      double* validation_loss) {
  const double rate = settings_.optimization().learning_rate();
  const double clustered = settings_.optimization().clustered_share() * epochs;
  const double cluster_weight = settings_.optimization().cluster_weight();
  return TrainOnTrajectories(
      phase, epochs,
      {{Part::kTrajectoryEncoder, rate}, {Part::kDecoder, rate}, {Part::kMixture, rate}},
      [this, clustered, cluster_weight](const at::Tensor& x, const Moment& moment,
                                        TermMeans* means) {
        SceneBatch batch{x, {}, {}};
        if (centers_.defined() && moment.epoch < clustered) batch.labels = ClustersOf(x);
        BaseModel model = ApplyBase(networks_, batch, NoiseDrawn());
        const bool by_bayes = settings_.optimization().weight_concentration() > 0.0;
        if (by_bayes) model.log_p_y = ExpectedLogWeights(WeightCounts());
        const BoundTerms terms = BaseBound(model);
        if (by_bayes) FollowWeightCounts(terms.log_responsibilities.exp());
        means->Add(terms);
        BoundWeights weights;
        weights.action = weights.latent_divergence = moment.divergence_share;
        const at::Tensor loss = Loss(terms, weights);
        if (cluster_weight <= 0.0 || !batch.labels.defined()) return loss;
        return loss + cluster_weight * HeldCrossEntropy(model).mean();
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
  const v1::OptimizationSettings& optimization = settings_.optimization();
  const absl::Status status = TrainMixtureFor("mixture", optimization.mixture_epochs(), &ignored);
  if (status.ok() && optimization.weight_concentration() > 0.0) {
    networks_.SwitchOff(UnneededActions(WeightCounts(), optimization.weight_concentration()));
  }
  return status;
}

}  // namespace maneuver::learning
