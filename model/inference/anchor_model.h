// The anchor baselines of a model folder (artifact/anchor_baselines.h), evaluated by the engine.
// For evaluations alone: the serving path never loads them.

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
  // From tensors that artifact::ReadBaselines accepts; with anchor_regression it is MultiPath-like,
  // else CoverNet-like. Errors: those of ActionModel::FromStored.
  static absl::StatusOr<std::shared_ptr<const AnchorModel>> Make(const v1::ModelSpec& spec,
                                                                 artifact::TensorMap weights,
                                                                 const EngineOptions& options);

  const v1::ModelSpec& spec() const { return scenes_->spec(); }
  // Reads scenes: its encodings hold p(k|s) and the features that Describe wants. One a thread.
  std::unique_ptr<InferenceSession> NewSession() const { return scenes_->NewSession(); }

  // Returns N(r + a_k + mu_k(s), Sigma_k(s)) at each waypoint, for all anchors; r is the encoding's
  // reference. `sigma` holds the mean alone, for there is no latent. [K]
  std::vector<ActionDistribution> Describe(const SceneEncoding& encoding,
                                           MlpScratch* scratch) const;
  // Returns the anchor with the smallest mean squared distance to the trajectory less the
  // encoding's reference. Learning takes it for the right one.
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

// Those of a folder.
struct AnchorBaselines {
  std::shared_ptr<const AnchorModel> covernet;
  std::shared_ptr<const AnchorModel> multipath;
};

// Errors: those of artifact::ReadBaselines; NOT_FOUND if the folder has none.
absl::StatusOr<AnchorBaselines> LoadAnchorBaselines(const std::filesystem::path& folder,
                                                    const EngineOptions& options);

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_ANCHOR_MODEL_H_
