// The anchor baselines of a model folder (artifact/anchor_baselines.h), evaluated by the engine.
// Only for evaluations: the server never loads them to serve.

#ifndef MANEUVER_MODEL_INFERENCE_ANCHOR_MODEL_H_
#define MANEUVER_MODEL_INFERENCE_ANCHOR_MODEL_H_

#include <filesystem>
#include <memory>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/tensor.h"
#include "model/inference/action_model.h"
#include "model/inference/mlp.h"

namespace maneuver::inference {

// One baseline in memory. Immutable; safe to share between threads.
class AnchorModel {
 public:
  // Makes a baseline from tensors that artifact::ReadBaselines accepts. With anchor_regression it
  // is MultiPath-like, otherwise CoverNet-like. Errors: those of ActionModel::FromStored.
  static absl::StatusOr<std::shared_ptr<const AnchorModel>> Make(const v1::ModelSpec& spec,
                                                                 artifact::TensorMap weights,
                                                                 const EngineOptions& options);

  const v1::ModelSpec& spec() const { return scenes_->spec(); }
  // Returns a session that reads scenes. Its encodings hold p(k|s) and the features that Describe
  // needs. Each thread needs its own.
  std::unique_ptr<InferenceSession> NewSession() const { return scenes_->NewSession(); }

  // Returns N(r + a_k + mu_k(s), Sigma_k(s)) at each waypoint, for all anchors; r is the encoding's
  // reference. `sigma` holds only the mean, because there is no latent. [K]
  std::vector<ActionDistribution> Describe(const SceneEncoding& encoding,
                                           MlpScratch* scratch) const;
  // Returns the anchor with the smallest mean squared distance to the trajectory minus the
  // encoding's reference. Learning treats it as the correct one.
  int Nearest(const SceneEncoding& encoding, const Trajectory& trajectory) const;

 private:
  AnchorModel(std::shared_ptr<const ActionModel> scenes, const artifact::TensorMap& weights);

  std::shared_ptr<const ActionModel> scenes_;
  std::vector<Trajectory> anchors_;  // [K] relative to the reference
  std::unique_ptr<const Mlp> regression_;
  // [K * T, 3] of the CoverNet-like one, square metres
  Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor> covariance_;
  Eigen::VectorXd scale_;  // [T] of the MultiPath-like one
};

// The baselines of a model folder.
struct AnchorBaselines {
  std::shared_ptr<const AnchorModel> covernet;
  std::shared_ptr<const AnchorModel> multipath;
};

// Loads the baselines of a folder. Errors: those of artifact::ReadBaselines, such as NOT_FOUND if
// the folder has none, and of AnchorModel::Make.
absl::StatusOr<AnchorBaselines> LoadAnchorBaselines(const std::filesystem::path& folder,
                                                    const EngineOptions& options);

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_ANCHOR_MODEL_H_
