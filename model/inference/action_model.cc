#include "model/inference/action_model.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/model_spec.h"
#include "model/artifact/tensor.h"
#include "model/inference/packed_networks.h"
#include "model/kernels/rescale.h"
#include "model/probability/responsibilities.h"
#include "model/probability/sigma_points.h"
#include "model/scene/motion_reference.h"

namespace maneuver::inference {
namespace {

using probability::DiagonalGaussian;
using RowMajorXf = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using probability::RowMajorXd;

// Rasters that are encoded together: bounds the scratch memory and still reads the projection's
// weights once for so many.
constexpr int kEncodingBlock = 16;

// Of q(z|x), either sign. Far beyond what any driven trajectory has. A jump of some hundred metres
// in a recording would otherwise have a variance that is infinite.
constexpr double kMostLogVariance = 60.0;

// [3T] as decoder_covariance yields them (tensor.h) to [T, 3] xx, xy, yy.
WaypointCovariances CovariancesOf(const Eigen::RowVectorXf& factors) {
  const auto stddev = [](float log_stddev) {
    return std::exp(static_cast<double>(
        std::clamp(log_stddev, artifact::kLeastLogStddev, artifact::kMostLogStddev)));
  };
  WaypointCovariances covariances(factors.size() / 3, 3);
  for (Eigen::Index t = 0; t < covariances.rows(); ++t) {
    const double l11 = stddev(factors[3 * t]);
    const double l22 = stddev(factors[3 * t + 1]);
    const double l21 = static_cast<double>(factors[3 * t + 2]) * l22;
    covariances.row(t) << l11 * l11, l11 * l21, l21 * l21 + l22 * l22;
  }
  return covariances;
}

// r(m), or empty for a model without a reference.
Trajectory RollOutReference(const v1::ModelSpec& spec, const scene::MotionEstimate& motion,
                            std::span<const double> waypoint_times) {
  if (!artifact::HasReference(spec)) return {};
  Trajectory reference(static_cast<Eigen::Index>(waypoint_times.size()), 2);
  scene::RollOut(spec.reference(), spec.inputs_version(), motion, waypoint_times,
                 {reference.data(), static_cast<size_t>(reference.size())});
  return reference;
}

class LoadedModel final : public ActionModel {
 public:
  LoadedModel(v1::ModelManifest manifest, const artifact::TensorMap& weights, bool bf16)
      : manifest_(std::move(manifest)), bf16_(bf16), networks_(manifest_.spec(), weights, bf16) {}

  const v1::ModelManifest& manifest() const override { return manifest_; }
  std::string_view precision() const override { return bf16_ ? "bf16" : "f32"; }
  size_t weight_bytes() const override { return networks_.bytes(); }
  std::unique_ptr<InferenceSession> NewSession() const override;

  const PackedNetworks& networks() const { return networks_; }

 private:
  v1::ModelManifest manifest_;
  bool bf16_;
  PackedNetworks networks_;
};

class Session final : public InferenceSession {
 public:
  explicit Session(std::shared_ptr<const LoadedModel> model)
      : model_(std::move(model)),
        networks_(model_->networks()),
        waypoint_times_(artifact::WaypointTimes(model_->spec().trajectory())) {
    if (networks_.backbone) scratch_ = networks_.backbone->NewScratch();
  }

  void Encode(std::span<const SceneInputsView> scenes,
              std::span<SceneEncoding> encodings) override {
    for (size_t begin = 0; begin < scenes.size(); begin += kEncodingBlock) {
      const size_t count = std::min<size_t>(kEncodingBlock, scenes.size() - begin);
      EncodeBlock(scenes.subspan(begin, count), encodings.subspan(begin, count));
    }
  }

  std::vector<ActionDistribution> Describe(const SceneEncoding& encoding,
                                           std::span<const int> actions,
                                           LatentSource source) override {
    if (actions.empty()) return {};
    const Eigen::Index points = 2 * networks_.mixture.dimensions() + 1;
    std::vector<ActionDistribution> distributions(actions.size());
    for (size_t i = 0; i < actions.size(); ++i) {
      const DiagonalGaussian latent = Latent(encoding, actions[i], source);
      distributions[i].action = actions[i];
      distributions[i].latent_mean = latent.mean;
      distributions[i].latent_stddev = latent.stddev();
    }
    DecodeSigmaPoints(distributions);
    FillDecoderCovariances(distributions);
    for (size_t i = 0; i < actions.size(); ++i) {
      FillTrajectories(points * static_cast<Eigen::Index>(i), points,
                       ShiftOf(encoding, actions[i], source), &distributions[i]);
      if (networks_.scene_covariance) AddSceneCovariance(encoding, &distributions[i]);
    }
    return distributions;
  }

  TrajectorySet MeanTrajectories(const SceneEncoding& encoding, std::span<const int> actions,
                                 LatentSource source) override {
    if (actions.empty()) return {};
    RowMajorXf latents(static_cast<Eigen::Index>(actions.size()), networks_.mixture.dimensions());
    for (size_t i = 0; i < actions.size(); ++i) {
      latents.row(static_cast<Eigen::Index>(i)) =
          Latent(encoding, actions[i], source).mean.cast<float>();
    }
    Decode(latents);
    RowMajorXd means = DecodedMetres(0, decoded_.rows());
    for (size_t i = 0; i < actions.size(); ++i) {
      const Eigen::RowVectorXd shift = ShiftOf(encoding, actions[i], source);
      if (shift.size() > 0) means.row(static_cast<Eigen::Index>(i)) += shift;
    }
    return TrajectorySet(std::move(means));
  }

  Classification Classify(const SceneEncoding& encoding, const Trajectory& trajectory) override {
    Eigen::VectorXd x = Eigen::Map<const Eigen::VectorXd>(trajectory.data(), trajectory.size());
    if (encoding.reference.size() > 0) {
      x -= Eigen::Map<const Eigen::VectorXd>(encoding.reference.data(), x.size());
    }
    const DiagonalGaussian latent = EncodeTrajectory(x);
    std::vector<DiagonalGaussian> posteriors;
    posteriors.reserve(static_cast<size_t>(networks_.mixture.components()));
    for (int k = 0; k < networks_.mixture.components(); ++k) {
      posteriors.push_back(Posterior(encoding, k));
    }
    // An action that the softmax gave 0 is impossible, which its logarithm says.
    const Eigen::VectorXd log_prior = encoding.probabilities.array().log();
    Decode(probability::SigmaPoints(latent.mean, latent.stddev()).cast<float>());
    probability::MomentsOfSigmaPoints(DecodedMetres(0, decoded_.rows()), &moments_);
    const double reconstruction =
        probability::ExpectedLogDensity(x, moments_, model_->spec().decoder_stddev());
    const v1::Objective objective = model_->spec().objective();
    const bool base = objective == v1::OBJECTIVE_BASE || objective == v1::OBJECTIVE_DUAL;
    return {base ? probability::BaseResponsibilities(log_prior, latent, networks_.mixture)
                 : probability::UnifiedResponsibilities(log_prior, latent, networks_.mixture,
                                                        posteriors),
            probability::BaseBound(reconstruction, log_prior, latent, networks_.mixture)};
  }

 private:
  void EncodeBlock(std::span<const SceneInputsView> scenes, std::span<SceneEncoding> encodings) {
    const Eigen::Index rows = static_cast<Eigen::Index>(scenes.size());
    if (networks_.backbone) EvaluateRasters(scenes);
    if (networks_.scene) {
      EvaluateVectors(scenes, encodings);
    } else if (model_->spec().target_motion()) {
      AppendMotion(scenes);
    }
    logits_.resize(rows, networks_.action_predictor.outputs());
    networks_.action_predictor.Apply(features_.data(), static_cast<int>(rows), &mlp_scratch_,
                                     logits_.data());
    if (networks_.actions) EvaluateActions(encodings);
    for (Eigen::Index r = 0; r < rows; ++r) {
      SceneEncoding& encoding = encodings[static_cast<size_t>(r)];
      encoding.features = features_.row(r);
      encoding.probabilities = probability::Softmax(logits_.row(r).transpose().cast<double>());
    }
  }

  // The backbone's features, into features_.
  void EvaluateRasters(std::span<const SceneInputsView> scenes) {
    const Eigen::Index rows = static_cast<Eigen::Index>(scenes.size());
    grids_.resize(rows, networks_.projection->inputs());
    for (Eigen::Index r = 0; r < rows; ++r) {
      networks_.backbone->Evaluate(*scenes[static_cast<size_t>(r)].raster, scratch_.get(),
                                   grids_.row(r).data());
    }
    features_.resize(rows, networks_.projection->outputs());
    networks_.projection->Apply(grids_.data(), static_cast<int>(rows), Activation::kRelu,
                                &mlp_scratch_.dense, features_.data());
  }

  // Joins the vectors, and the backbone's features if features_ holds them, into features_. Rolls
  // out the references.
  void EvaluateVectors(std::span<const SceneInputsView> scenes,
                       std::span<SceneEncoding> encodings) {
    vectors_.clear();
    for (size_t i = 0; i < scenes.size(); ++i) {
      vectors_.push_back(scenes[i].vectors);
      const scene::MotionEstimate& motion = scenes[i].vectors->motion;
      encodings[i].speed = motion.speed;
      encodings[i].reference = RollOutReference(model_->spec(), motion, waypoint_times_);
    }
    networks_.scene->Evaluate(vectors_, networks_.backbone ? features_.data() : nullptr,
                              &scene_features_);
    features_ = Eigen::Map<const RowMajorXf>(scene_features_.features.data(),
                                             static_cast<Eigen::Index>(scenes.size()),
                                             networks_.scene->features());
  }

  // h_y of all actions, and what it adds to logits_. After EvaluateVectors.
  void EvaluateActions(std::span<SceneEncoding> encodings) {
    references_.clear();
    for (const SceneEncoding& encoding : encodings) references_.push_back(&encoding.reference);
    networks_.actions->Evaluate(vectors_, references_, scene_features_, &action_features_);
    logits_ += Eigen::Map<const RowMajorXf>(action_features_.logits.data(), logits_.rows(),
                                            logits_.cols());
    const Eigen::Index features = networks_.actions->features();
    for (size_t i = 0; i < encodings.size(); ++i) {
      encodings[i].geometry =
          Eigen::Map<const RowMajorXf>(action_features_.geometry.data() +
                                           static_cast<Eigen::Index>(i) * logits_.cols() * features,
                                       logits_.cols(), features);
    }
  }

  // The targets' motion, to the right of the features.
  void AppendMotion(std::span<const SceneInputsView> scenes) {
    const Eigen::Index features = networks_.projection->outputs();
    RowMajorXf appended(features_.rows(), features + scene::kMotionInputs);
    appended.leftCols(features) = features_;
    for (Eigen::Index r = 0; r < appended.rows(); ++r) {
      appended.row(r).tail<scene::kMotionInputs>() =
          Eigen::Map<const Eigen::RowVector<float, scene::kMotionInputs>>(
              scenes[static_cast<size_t>(r)].motion.data());
    }
    features_ = std::move(appended);
  }

  // Where z of an action comes from: q(z|y,s) or p(z|y).
  DiagonalGaussian Latent(const SceneEncoding& encoding, int action, LatentSource source) {
    return source == LatentSource::kPosterior ? Posterior(encoding, action)
                                              : networks_.mixture.Component(action);
  }

  // q(z|y=k,s), which the scenario encoder states relative to the component (tensor.h).
  DiagonalGaussian Posterior(const SceneEncoding& encoding, int k) {
    Eigen::VectorXf outputs(networks_.scenario_encoders.front().outputs());
    networks_.scenario_encoders[static_cast<size_t>(k)].Apply(encoding.features.data(), 1,
                                                              &mlp_scratch_, outputs.data());
    if (networks_.actions) {
      networks_.actions->AddLatent(k, encoding.geometry.row(k).data(), &mlp_scratch_.dense,
                                   &outputs);
    }
    const Eigen::Index dimensions = networks_.mixture.dimensions();
    DiagonalGaussian posterior = networks_.mixture.Component(k);
    posterior.mean += posterior.stddev().cwiseProduct(outputs.head(dimensions).cast<double>());
    posterior.log_variance += outputs.tail(dimensions).cast<double>();
    return posterior;
  }

  // q(z|x) of a flattened trajectory in metres, relative to the reference.
  DiagonalGaussian EncodeTrajectory(const Eigen::VectorXd& x) {
    const Eigen::VectorXf standardized =
        (x - networks_.trajectory_mean).cwiseQuotient(networks_.trajectory_stddev).cast<float>();
    Eigen::VectorXf outputs(networks_.trajectory_encoder.outputs());
    networks_.trajectory_encoder.Apply(standardized.data(), 1, &mlp_scratch_, outputs.data());
    const Eigen::Index dimensions = networks_.mixture.dimensions();
    return {outputs.head(dimensions).cast<double>(), outputs.tail(dimensions)
                                                         .cast<double>()
                                                         .cwiseMax(-kMostLogVariance)
                                                         .cwiseMin(kMostLogVariance)};
  }

  // Means of p(x|z), standardized, into decoded_, [N, 2T].
  //   latents: [N, D]
  void Decode(const RowMajorXf& latents) {
    decoded_.resize(latents.rows(), networks_.decoder.outputs());
    networks_.decoder.Apply(latents.data(), static_cast<int>(latents.rows()), &mlp_scratch_,
                            decoded_.data());
  }

  // Decodes the sigma points of all distributions' latents, in one product, into decoded_.
  void DecodeSigmaPoints(std::span<const ActionDistribution> distributions) {
    const Eigen::Index dimensions = networks_.mixture.dimensions();
    const auto actions = static_cast<Eigen::Index>(distributions.size());
    if (networks_.sigma_decoder) {
      RowMajorXf means(actions, dimensions);
      RowMajorXf stddevs(actions, dimensions);
      for (Eigen::Index i = 0; i < actions; ++i) {
        const ActionDistribution& distribution = distributions[static_cast<size_t>(i)];
        means.row(i) = distribution.latent_mean.cast<float>();
        stddevs.row(i) = distribution.latent_stddev.cast<float>();
      }
      networks_.sigma_decoder->Decode(networks_.decoder, means, stddevs, &mlp_scratch_,
                                      &sigma_scratch_, &decoded_);
      return;
    }
    const Eigen::Index points = 2 * dimensions + 1;
    RowMajorXf latents(points * actions, dimensions);
    for (Eigen::Index i = 0; i < actions; ++i) {
      const ActionDistribution& distribution = distributions[static_cast<size_t>(i)];
      latents.middleRows(points * i, points) =
          probability::SigmaPoints(distribution.latent_mean, distribution.latent_stddev)
              .cast<float>();
    }
    Decode(latents);
  }

  // Rows of decoded_ in metres, relative to the reference, then moved by `shift` unless it is empty.
  // [count, 2T]
  RowMajorXd DecodedMetres(Eigen::Index first, Eigen::Index count,
                           const Eigen::RowVectorXd& shift = {}) const {
    RowMajorXd metres(count, decoded_.cols());
    kernels::Rescale(decoded_.row(first).data(), static_cast<int>(count),
                     static_cast<int>(decoded_.cols()), networks_.trajectory_stddev.data(),
                     networks_.trajectory_mean.data(), shift.size() > 0 ? shift.data() : nullptr,
                     metres.data());
    return metres;
  }

  // What an action's decoded trajectories are moved by, metres: the reference, and in a posterior
  // the residual of the mean. [2T], or empty where there is neither.
  Eigen::RowVectorXd ShiftOf(const SceneEncoding& encoding, int k, LatentSource source) {
    Eigen::RowVectorXd shift;
    if (networks_.mean_residual && source == LatentSource::kPosterior) {
      const float* geometry = networks_.actions ? encoding.geometry.row(k).data() : nullptr;
      shift = networks_.mean_residual->Evaluate(encoding.features.data(), geometry, k,
                                                &mlp_scratch_.dense);
    }
    if (encoding.reference.size() == 0) return shift;
    const Eigen::Map<const Eigen::RowVectorXd> reference(encoding.reference.data(),
                                                         encoding.reference.size());
    if (shift.size() == 0) return reference;
    return shift + reference;
  }

  // Covariance of p(x|z) at the mean of each distribution's latent, into its moments. 0 where the
  // scene predicts it, which needs the mean first.
  void FillDecoderCovariances(std::span<ActionDistribution> distributions) {
    const Eigen::Index waypoints = networks_.trajectory_mean.size() / 2;
    if (networks_.scene_covariance) {
      for (ActionDistribution& distribution : distributions) {
        distribution.moment_covariance = WaypointCovariances::Zero(waypoints, 3);
      }
      return;
    }
    if (!networks_.covariance_network) {
      for (ActionDistribution& distribution : distributions) {
        distribution.moment_covariance =
            networks_.decoder_covariance.middleRows(distribution.action * waypoints, waypoints);
      }
      return;
    }
    RowMajorXf latents(static_cast<Eigen::Index>(distributions.size()),
                       networks_.mixture.dimensions());
    for (size_t i = 0; i < distributions.size(); ++i) {
      latents.row(static_cast<Eigen::Index>(i)) = distributions[i].latent_mean.cast<float>();
    }
    RowMajorXf factors(latents.rows(), 3 * waypoints);
    networks_.covariance_network->Apply(latents.data(), static_cast<int>(latents.rows()),
                                        &mlp_scratch_, factors.data());
    for (size_t i = 0; i < distributions.size(); ++i) {
      distributions[i].moment_covariance = CovariancesOf(factors.row(static_cast<Eigen::Index>(i)));
    }
  }

  // Computes the sigma trajectories and the moments of a distribution
  // (probability::MomentsOfSigmaPoints) from rows of decoded_, its decoded sigma points. The moments
  // already hold the covariance of p(x|z).
  //   shift: from ShiftOf
  void FillTrajectories(Eigen::Index first, Eigen::Index points, const Eigen::RowVectorXd& shift,
                        ActionDistribution* distribution) {
    RowMajorXd images = DecodedMetres(first, points, shift);
    const Eigen::Index waypoints = images.cols() / 2;
    distribution->moment_mean.resize(waypoints, 2);
    probability::MomentsOfSigmaPoints(images, &moments_);
    Eigen::Map<Eigen::VectorXd>(distribution->moment_mean.data(), images.cols()) = moments_.mean;
    WaypointCovariances& covariance = distribution->moment_covariance;
    for (Eigen::Index t = 0; t < waypoints; ++t) {
      double xx = covariance(t, 0);
      double xy = covariance(t, 1);
      double yy = covariance(t, 2);
      for (Eigen::Index d = 0; d < moments_.deviations.rows(); ++d) {
        const double x = moments_.deviations(d, 2 * t);
        const double y = moments_.deviations(d, 2 * t + 1);
        xx += x * x;
        xy += x * y;
        yy += y * y;
      }
      covariance.row(t) << xx, xy, yy;
    }
    distribution->sigma = TrajectorySet(std::move(images));
  }

  // Adds the covariance that the scene predicts to a distribution that has its mean.
  void AddSceneCovariance(const SceneEncoding& encoding, ActionDistribution* distribution) {
    // Without a scene, the networks are evaluated at features of 0.
    if (encoding.features.size() == 0) {
      no_features_.setZero(artifact::SceneFeatureCount(model_->spec()));
    }
    const Eigen::VectorXf& features =
        encoding.features.size() == 0 ? no_features_ : encoding.features;
    distribution->moment_covariance += networks_.scene_covariance->Evaluate(
        features.data(), distribution->action, distribution->moment_mean, encoding.speed,
        &mlp_scratch_);
  }

  std::shared_ptr<const LoadedModel> model_;
  const PackedNetworks& networks_;
  const std::vector<double> waypoint_times_;  // seconds
  Backbone::ScratchPointer scratch_;          // null without a backbone
  MlpScratch mlp_scratch_;
  SigmaScratch sigma_scratch_;
  SceneVectorFeatures scene_features_;
  ActionFeatures action_features_;
  std::vector<const scene::SceneVectors*> vectors_;
  std::vector<const Trajectory*> references_;
  Eigen::VectorXf no_features_;  // [F'] zeros
  RowMajorXf grids_;             // [rows, h * w * C]
  RowMajorXf features_;          // [rows, F']
  RowMajorXf logits_;            // [rows, K]
  RowMajorXf decoded_;           // [sigma points, 2T]
  probability::SigmaMoments moments_;
};

std::unique_ptr<InferenceSession> LoadedModel::NewSession() const {
  return std::make_unique<Session>(std::static_pointer_cast<const LoadedModel>(shared_from_this()));
}

}  // namespace

SceneEncoding DrivingStraight(const v1::ModelSpec& spec, double speed) {
  SceneEncoding encoding;
  encoding.reference =
      RollOutReference(spec, {.speed = speed}, artifact::WaypointTimes(spec.trajectory()));
  encoding.speed = speed;
  return encoding;
}

absl::StatusOr<std::shared_ptr<const ActionModel>> ActionModel::Load(
    const std::filesystem::path& folder, const EngineOptions& options) {
  absl::StatusOr<artifact::StoredModel> stored = artifact::ReadModelFolder(folder);
  if (!stored.ok()) return stored.status();
  return FromStored(*std::move(stored), options);
}

absl::StatusOr<std::shared_ptr<const ActionModel>> ActionModel::FromStored(
    artifact::StoredModel stored, const EngineOptions& options) {
  if (options.precision == Precision::kBf16 && !ProcessorHasBf16()) {
    return absl::FailedPreconditionError(
        "this processor does not compute with bf16; load the model with precision f32 or auto");
  }
  const bool bf16 = options.precision != Precision::kF32 && ProcessorHasBf16();
  try {
    return std::make_shared<const LoadedModel>(std::move(stored.manifest), stored.weights, bf16);
  } catch (const std::exception& error) {  // dnnl::error, std::bad_alloc
    return absl::InternalError(absl::StrCat("cannot prepare the networks: ", error.what()));
  }
}

}  // namespace maneuver::inference
