#include "model/learning/validation.h"

#include <Eigen/Core>
#include <algorithm>

#include "model/evaluation/calibration.h"
#include "model/learning/moments.h"
#include "model/scene/rasterizer.h"

namespace maneuver::learning {
namespace {

constexpr int64_t kMostValidated = 2048;  // examples an epoch
constexpr int64_t kBatch = 64;
// Of these, every fourth batch is also described action by action: some fifty times the work.
constexpr int kDescribedBatches = 4;

using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// e to these powers, [N, K], all of them brought from the device at once.
Rows Exponentials(const at::Tensor& logarithms) {
  const at::Tensor values = logarithms.exp().to(at::kCPU, at::kDouble).contiguous();
  return Eigen::Map<const Rows>(values.data_ptr<double>(), values.size(0), values.size(1));
}

// Usage of the actions by q(y|x,s), and what p(y|s) is like.
class UsageReport {
 public:
  explicit UsageReport(int actions)
      : statistics_(actions), responsibilities_(Eigen::VectorXd::Zero(actions)) {}

  void Add(const at::Tensor& log_p_y, const at::Tensor& log_q_y) {
    const Rows p = Exponentials(log_p_y);
    const Rows q = Exponentials(log_q_y);
    for (Eigen::Index i = 0; i < q.rows(); ++i) {
      statistics_.Add(p.row(i).transpose(), q.row(i).transpose());
      responsibilities_ += q.row(i).transpose();
      ++count_;
    }
  }

  void Write(v1::EpochReport* report) const {
    if (count_ == 0) return;
    for (const double usage : responsibilities_) {
      report->add_action_usage(usage / static_cast<double>(count_));
    }
    report->set_effective_actions(statistics_.EffectiveActions());
    report->set_action_perplexity(statistics_.Perplexity());
    report->set_mutual_information(statistics_.MutualInformation());
  }

 private:
  evaluation::ActionStatistics statistics_;
  Eigen::VectorXd responsibilities_;
  int64_t count_ = 0;
};

}  // namespace

void TermMeans::Add(const std::string& name, const at::Tensor& values, int64_t examples) {
  Sum& sum = sums_[name];
  sum.sum += values.detach().mean().item<double>() * static_cast<double>(examples);
  sum.count += examples;
}

void TermMeans::Add(const BoundTerms& terms) {
  const auto add = [this](const char* name, const at::Tensor& values) {
    if (values.defined()) Add(name, values, values.size(0));
  };
  add("reconstruction", terms.reconstruction);
  add("action_divergence", terms.action_divergence);
  add("latent_divergence", terms.latent_divergence);
  add("posterior_reconstruction", terms.posterior_reconstruction);
  add("posterior_divergence", terms.posterior_divergence);
}

void TermMeans::Write(google::protobuf::Map<std::string, double>* means) const {
  for (const auto& [name, sum] : sums_) {
    (*means)[name] = sum.sum / static_cast<double>(sum.count);
  }
}

void TermMeans::Store(StoredSums* sums) const {
  for (const auto& [name, sum] : sums_) {
    StoredMean& stored = (*sums)[name];
    stored.set_sum(sum.sum);
    stored.set_count(sum.count);
  }
}

void TermMeans::Add(const StoredSums& sums) {
  for (const auto& [name, stored] : sums) {
    sums_[name].sum += stored.sum();
    sums_[name].count += stored.count();
  }
}

at::Tensor Trajectories(const std::vector<data::Example>& examples) {
  if (examples.empty()) return at::empty({0, 0});
  const int64_t coordinates = static_cast<int64_t>(examples.front().trajectory.size());
  at::Tensor rows = at::empty({static_cast<int64_t>(examples.size()), coordinates}, at::kFloat);
  float* row = rows.data_ptr<float>();
  for (const data::Example& example : examples) {
    for (size_t i = 0; i < example.trajectory.size(); ++i) {
      *row++ = example.trajectory[i] - (example.reference.empty() ? 0.0F : example.reference[i]);
    }
  }
  return rows;
}

std::vector<SceneLoader::Item> DrawItems(const ExampleSet& set, int64_t most) {
  const int64_t all = static_cast<int64_t>(set.examples.size());
  const int64_t count = std::min(all, most);
  std::vector<SceneLoader::Item> items;
  for (int64_t i = 0; i < count; ++i) items.push_back({i * all / count, {}});
  return items;
}

at::Tensor BatchLabels(const std::vector<int>& labels, const SceneLoader::Batch& batch) {
  if (labels.empty()) return {};
  at::Tensor of_batch = at::empty({static_cast<int64_t>(batch.items.size())}, at::kLong);
  int64_t* label = of_batch.data_ptr<int64_t>();
  for (const SceneLoader::Item& item : batch.items) {
    *label++ = item.variation.mirror ? -1 : labels[static_cast<size_t>(item.example)];
  }
  return of_batch;
}

void ReportMixture(const Networks& networks, v1::EpochReport* report) {
  const at::Tensor stddev = (0.5 * networks["mixture.log_variance"].detach()).exp();
  report->set_smallest_component_stddev(stddev.min().item<double>());
  report->set_largest_component_stddev(stddev.max().item<double>());
}

void ValidateBase(const Networks& networks, const at::Tensor& trajectories, bool has_mixture,
                  v1::EpochReport* report) {
  if (has_mixture) ReportMixture(networks, report);
  if (trajectories.size(0) == 0) return;
  at::NoGradGuard no_grad;
  const at::Tensor x = trajectories.to(networks.device());
  const Gaussian q_z = networks.EncodeTrajectories(x);
  const double stddev = networks.spec().decoder_stddev();
  TermMeans means;
  if (has_mixture) {
    const at::Tensor log_p_y = networks.MixtureLogWeights();
    const BoundTerms terms =
        BaseBound({x, networks.Decode(q_z.mean), q_z, networks.Mixture(), log_p_y, stddev});
    means.Add(terms);
    means.Add("loss", Loss(terms, {}), x.size(0));
    UsageReport usage(networks.spec().actions());
    // p(y) knows no scenario: what can be effective is what q(y|x) uses.
    usage.Add(terms.log_responsibilities, terms.log_responsibilities);
    usage.Write(report);
    report->set_mutual_information(0.0);
  } else {
    const at::Tensor reconstruction = LogLikelihood(x, networks.Decode(q_z.mean), stddev);
    const at::Tensor divergence =
        Divergence(q_z, StandardNormal(q_z.mean.size(1), networks.device()));
    means.Add("reconstruction", reconstruction, x.size(0));
    means.Add("latent_divergence", divergence, x.size(0));
    means.Add("loss", divergence - reconstruction, x.size(0));
  }
  means.Write(report->mutable_validation());
}

void ValidateScenes(Networks& networks, const SceneSource& source, v1::Objective objective,
                    const v1::OptimizationSettings& optimization, int threads,
                    const std::function<bool()>& stopped, v1::EpochReport* report) {
  ReportMixture(networks, report);
  if (source.set().examples.empty()) return;
  at::NoGradGuard no_grad;
  const v1::ModelSpec& spec = networks.spec();
  const double stddev = spec.decoder_stddev();
  const BoundWeights weights = Weights(optimization);
  const NoiseSource means_for_samples = [&networks](at::IntArrayRef shape) {
    return at::zeros(shape, networks.device());
  };
  TermMeans means;
  UsageReport usage(spec.actions());
  SceneLoader loader(spec, source, DrawItems(source.set(), kMostValidated), kBatch, threads);
  for (int64_t index = 0; std::optional<SceneLoader::Batch> batch = loader.Next(); ++index) {
    if (stopped()) return;
    const at::Tensor x = batch->trajectories.to(networks.device());
    const SceneFeatures scenes = networks.EncodeScenes(batch->scenes, {});
    const BoundTerms terms = SceneBound(networks, objective, Learning::kPosterior, optimization,
                                        {x, scenes, {}}, means_for_samples);
    means.Add(terms);
    means.Add("loss", Loss(terms, weights), x.size(0));
    const at::Tensor log_p_y = networks.PredictActions(scenes);
    usage.Add(log_p_y, terms.log_responsibilities);
    if (index % kDescribedBatches != 0) continue;
    const WaypointMoments moments =
        LatentMoments(networks, networks.EncodeScenarios(scenes), networks.MeanResidual(scenes));
    const at::Tensor own =
        at::tensor({stddev * stddev, 0.0, stddev * stddev}, moments.covariance.options());
    means.Add("log_likelihood",
              WaypointLogLikelihood(log_p_y, moments.mean, moments.covariance + own, x).mean(1),
              x.size(0));
  }
  means.Write(report->mutable_validation());
  usage.Write(report);
}

}  // namespace maneuver::learning
