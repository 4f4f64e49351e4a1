#include "model/learning/learner.h"

#include <ATen/Parallel.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "model/learning/calibration.h"
#include "model/learning/raster_loader.h"
#include "model/learning/trajectory_clusters.h"

namespace maneuver::learning {
namespace {

using Part = Networks::Part;

constexpr int64_t kWarmUp = 100;  // steps
// Trajectories alone are small: twice the batch costs the same time.
constexpr int64_t kTrajectoryBatchFactor = 2;
constexpr int kClusterRestarts = 3;
constexpr double kSidewaysWeight = 2.0;
constexpr double kReach = 10.0;             // metres
constexpr int64_t kMostClustered = 16'384;  // examples
// Variance of a component that starts from few encodings.
constexpr double kSmallestVariance = 1e-3;
// Components with fewer encodings take their variance from all.
constexpr int64_t kFewEncodings = 10;

int64_t StepsOfEpoch(int64_t examples, int64_t batch_size) {
  // A last batch of one has no moments for the batch normalisation: it is left out.
  return examples / batch_size + (examples % batch_size > 1 ? 1 : 0);
}

int64_t EpochExamples(const v1::TrainingSettings& settings, int64_t examples) {
  const int64_t most = settings.examples().max_examples();
  return most > 0 ? std::min(most, examples) : examples;
}

// Trajectories [N, 2T] as the clusters are to tell them apart. In plain metres nearly all clusters
// would be speeds of going straight on, which q(z|y,s) knows from the scenario anyway: far ones are
// drawn closer together, and what goes to the side counts for more.
at::Tensor ClusterSpace(const at::Tensor& trajectories) {
  const at::Tensor points = trajectories.view({trajectories.size(0), -1, 2});
  const at::Tensor reach = points.square().sum(2).amax(1).sqrt().view({-1, 1, 1});
  const at::Tensor weights = at::tensor({1.0F, static_cast<float>(kSidewaysWeight)});
  return (points * weights / (1.0 + reach / kReach).sqrt()).flatten(1).contiguous();
}

BoundWeights Weights(const v1::OptimizationSettings& optimization) {
  return {optimization.action_weight(), optimization.posterior_reconstruction_weight(),
          optimization.posterior_divergence_weight()};
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

std::vector<RunProgress::Phase> Learner::Plan(const v1::TrainingSettings& settings,
                                              int64_t training_examples) {
  const v1::OptimizationSettings& optimization = settings.optimization();
  const int64_t batch = optimization.batch_size();
  const int64_t examples = EpochExamples(settings, training_examples);
  const int64_t short_epoch = StepsOfEpoch(examples, batch * kTrajectoryBatchFactor);
  const int64_t long_epoch = StepsOfEpoch(examples, batch);
  // Costs of a step relative to one of pretraining, for the compact preset.
  return {
      {"load", 1, 1, 1.0},
      {"pretrain", optimization.pretraining_epochs(),
       optimization.pretraining_epochs() * short_epoch, 1.0},
      {"mixture", optimization.mixture_epochs(), optimization.mixture_epochs() * short_epoch, 1.3},
      {"joint", optimization.joint_epochs(), optimization.joint_epochs() * long_epoch, 30.0},
      {"calibrate", 1, CalibrationSteps(training_examples), 15.0},
      {"export", 1, 1, 1.0},
      {"evaluate", 1, 100, 7.0}};
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
      trajectories_(Trajectories(data.training.examples)),
      validation_trajectories_(Trajectories(data.validation.examples)) {
  networks_.Standardize(trajectories_, settings.augmentation().mirror());
}

at::Tensor Learner::Noise(at::IntArrayRef shape) {
  return at::empty(shape, at::kFloat).normal_(0.0, 1.0, generator_).to(networks_.device());
}

at::Tensor Learner::DrawEpoch() {
  const int64_t examples = trajectories_.size(0);
  return at::randperm(examples, generator_, at::kLong)
      .slice(0, 0, EpochExamples(settings_, examples));
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
  progress_.BeginPhase(phase);
  const OneThread one_thread;
  const int64_t batch_size = settings_.optimization().batch_size() * kTrajectoryBatchFactor;
  const int64_t examples = EpochExamples(settings_, trajectories_.size(0));
  const int64_t epoch_steps = StepsOfEpoch(examples, batch_size);
  AdamW optimizer;
  for (const Group& group : groups) {
    optimizer.Add(networks_.Parameters(group.part), group.rate,
                  settings_.optimization().weight_decay());
  }
  int64_t step = 0;
  for (int epoch = 1; epoch <= epochs; ++epoch) {
    progress_.BeginEpoch(epoch);
    const at::Tensor order = DrawEpoch();
    TermMeans means;
    for (int64_t i = 0; i < epoch_steps; ++i, ++step) {
      if (stopped_()) return absl::CancelledError("training was stopped");
      const at::Tensor batch =
          order.slice(0, i * batch_size, std::min(examples, (i + 1) * batch_size));
      const at::Tensor x = Vary(trajectories_.index_select(0, batch));
      const at::Tensor value = loss(x, &means);
      means.Add("loss", value, x.size(0));
      const absl::Status status =
          TakeStep(value, LearningRateShare(step, kWarmUp, epochs * epoch_steps), &optimizer);
      if (!status.ok()) return status;
      progress_.Step(x.size(0));
    }
    progress_.EndEpoch(report(std::move(means)));
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

absl::Status Learner::PlaceMixture() {
  if (stopped_()) return absl::CancelledError("training was stopped");
  at::NoGradGuard no_grad;
  // Where left and right are swapped at random, clusters are of both sides.
  const int64_t count = std::min(trajectories_.size(0), kMostClustered);
  at::Tensor placed = trajectories_.index_select(
      0, at::arange(count, at::kLong).mul_(trajectories_.size(0)).floor_divide_(count));
  if (settings_.augmentation().mirror()) {
    at::Tensor mirrored = placed.clone().view({count, -1, 2});
    mirrored.select(2, 1).neg_();
    placed = at::cat({placed, mirrored.flatten(1)});
  }
  const int actions = settings_.model().actions();
  const at::Tensor features = ClusterSpace(placed);
  const TrajectoryClusters clusters =
      ClusterTrajectories(Eigen::Map<const TrajectoryRows>(features.data_ptr<float>(),
                                                           features.size(0), features.size(1)),
                          actions, static_cast<uint64_t>(settings_.seed()), kClusterRestarts);

  const Gaussian q_z = networks_.EncodeTrajectories(placed.to(networks_.device()));
  const at::Tensor variance = q_z.log_variance.exp();
  const at::Tensor everywhere = q_z.mean.var(0, /*unbiased=*/false) + variance.mean(0);
  const at::Tensor assignment =
      at::tensor(at::ArrayRef<int>(clusters.assignment), at::kLong).to(networks_.device());
  for (int k = 0; k < actions; ++k) {
    const at::Tensor members = (assignment == k).nonzero().flatten();
    const int64_t size = members.size(0);
    if (size == 0) continue;  // fewer different trajectories than actions
    const at::Tensor means = q_z.mean.index_select(0, members);
    const at::Tensor spread = size < kFewEncodings ? everywhere / actions
                                                   : means.var(0, /*unbiased=*/false) +
                                                         variance.index_select(0, members).mean(0);
    networks_["mixture.mean"][k].copy_(means.mean(0));
    networks_["mixture.log_variance"][k].copy_(spread.clamp_min(kSmallestVariance).log());
    networks_["mixture.log_weight"][k].fill_(
        std::log(static_cast<double>(size) / static_cast<double>(placed.size(0))));
  }
  return absl::OkStatus();
}

BaseModel Learner::ApplyBase(const at::Tensor& trajectories) {
  const Gaussian q_z = networks_.EncodeTrajectories(trajectories);
  const at::Tensor decoded = networks_.Decode(Sample(q_z, Noise(q_z.mean.sizes())));
  return {trajectories,        decoded,      q_z,
          networks_.Mixture(), at::Tensor(), settings_.model().decoder_stddev()};
}

absl::Status Learner::TrainMixture() {
  const double rate = settings_.optimization().learning_rate();
  return TrainOnTrajectories(
      "mixture", settings_.optimization().mixture_epochs(),
      {{Part::kTrajectoryEncoder, rate}, {Part::kDecoder, rate}, {Part::kMixture, rate}},
      [this](const at::Tensor& x, TermMeans* means) {
        BaseModel model = ApplyBase(x);
        model.log_p_y = networks_.MixtureLogWeights();
        const BoundTerms terms = BaseBound(model);
        means->Add(terms);
        return Loss(terms, {});
      },
      [this](TermMeans means) {
        v1::EpochReport report;
        means.Write(report.mutable_training());
        ValidateBase(networks_, validation_trajectories_, /*has_mixture=*/true, &report);
        return report;
      });
}

absl::Status Learner::TrainJointly() {
  progress_.BeginPhase("joint");
  const v1::OptimizationSettings& optimization = settings_.optimization();
  const double rate = optimization.learning_rate();
  const double latent_rate = rate * optimization.latent_learning_rate_share();
  const double decay = optimization.weight_decay();
  AdamW optimizer;
  for (const Part part : {Part::kBackbone, Part::kActions, Part::kScenarioEncoder}) {
    optimizer.Add(networks_.Parameters(part), rate, decay);
  }
  for (const Part part : {Part::kTrajectoryEncoder, Part::kDecoder, Part::kMixture}) {
    optimizer.Add(networks_.Parameters(part), latent_rate, decay);
  }
  const v1::RasterSpec& raster = settings_.model().raster();
  const int64_t examples = EpochExamples(settings_, trajectories_.size(0));
  const int64_t batch_size = optimization.batch_size();
  const int64_t epoch_steps = StepsOfEpoch(examples, batch_size);
  const int64_t steps = epoch_steps * optimization.joint_epochs();
  const BoundWeights weights = Weights(optimization);
  const uint64_t seed = static_cast<uint64_t>(settings_.seed());
  int64_t step = 0;
  for (int epoch = 1; epoch <= optimization.joint_epochs(); ++epoch) {
    progress_.BeginEpoch(epoch);
    const at::Tensor order = DrawEpoch();
    std::vector<RasterLoader::Item> items;
    for (int64_t i = 0; i < examples; ++i) {
      const int64_t example = order.data_ptr<int64_t>()[i];
      items.push_back({example, DrawVariation(settings_.augmentation(), seed, epoch, example)});
    }
    if (examples % batch_size == 1) items.pop_back();
    RasterLoader loader(raster, data_.training, std::move(items), batch_size, threads_);
    TermMeans means;
    while (std::optional<RasterLoader::Batch> batch = loader.Next()) {
      if (stopped_()) return absl::CancelledError("training was stopped");
      const at::Tensor x = VariedTrajectories(data_.training, *batch).to(networks_.device());
      const at::Tensor features =
          networks_.EncodeScenes(RasterTensor(raster, *batch), {&generator_});
      BaseModel model = ApplyBase(x);
      model.log_p_y = networks_.PredictActions(features);
      const Gaussian posterior = networks_.EncodeScenarios(features);
      const at::Tensor decoded = networks_.Decode(Sample(posterior, Noise(posterior.mean.sizes())));
      const BoundTerms terms = UnifiedBound(model, {decoded, posterior});
      const at::Tensor loss = Loss(terms, weights);
      means.Add(terms);
      means.Add("loss", loss, x.size(0));
      const absl::Status status =
          TakeStep(loss, LearningRateShare(step, kWarmUp, steps), &optimizer);
      if (!status.ok()) return status;
      ++step;
      progress_.Step(x.size(0));
    }
    v1::EpochReport report;
    means.Write(report.mutable_training());
    ValidateUnified(networks_, data_.validation, weights, threads_, stopped_, &report);
    progress_.EndEpoch(report);
  }
  optimizer.ZeroGradients();
  return absl::OkStatus();
}

absl::Status Learner::Calibrate() {
  progress_.BeginPhase("calibrate");
  progress_.BeginEpoch(1);
  return CalibrateModel(networks_, data_, threads_, generator_, stopped_,
                        [this](int64_t examples) { progress_.Step(examples); });
}

}  // namespace maneuver::learning
