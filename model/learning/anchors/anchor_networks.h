// The networks of the anchor baselines as LibTorch tensors (artifact/anchor_baselines.h).

#ifndef MANEUVER_MODEL_LEARNING_ANCHORS_ANCHOR_NETWORKS_H_
#define MANEUVER_MODEL_LEARNING_ANCHORS_ANCHOR_NETWORKS_H_

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "model/artifact/tensor.h"
#include "model/learning/networks.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Trajectories that anchors are, and how far examples are from their own.
struct Anchors {
  at::Tensor mean;       // a_k, [K, T, 2] metres
  at::Tensor deviation;  // root mean square of x - a_k over a cluster, [K, T, 2] metres, positive
};

// k-means in metres on at most 16,384 of the trajectories, drawn evenly.
//   trajectories: [N, 2T] metres, on the CPU;  N >= K
//   mirrored: with the mirror image of each, as learning sees them
Anchors PlaceAnchors(const at::Tensor& trajectories, int anchors, bool mirrored, uint64_t seed);

// The anchor with the smallest mean squared distance. trajectories [B, 2T] -> [B] indices
at::Tensor NearestAnchor(const at::Tensor& anchors, const at::Tensor& trajectories);

// What a baseline says of B scenes.
struct AnchorPredictions {
  at::Tensor log_probabilities;  // ln p(k|s), [B, K]
  at::Tensor mean;               // a_k + mu_k(s), [B, K, T, 2] metres
  at::Tensor covariance;         // Sigma_k(s), [B, K, T, 3] xx, xy, yy, square metres
};

// -ln p(k^|s), k^ the nearest anchor: CoverNet's loss (Phan-Minh et al., CVPR 2020, section 3.3).
// [B]
at::Tensor ClassifierLoss(const AnchorPredictions& predictions, const at::Tensor& nearest);

// MultiPath's imitation loss (Chai et al., CoRL 2019, equation 3), with hard assignment:
//   -ln p(k^|s) - sum_t ln N(x_t | a_k^t + mu_k^t(s), Sigma_k^t(s)).
// [B]
at::Tensor MultiPathLoss(const AnchorPredictions& predictions, const at::Tensor& nearest,
                         const at::Tensor& trajectories);

// The last dimension from the numbers of AnchorGaussian (ln sigma_x, ln sigma_y, correlation) to
// xx, xy, yy. [.., 3]
at::Tensor AnchorCovariance(const at::Tensor& numbers);

// One baseline. Not thread-safe.
class AnchorNetworks {
 public:
  // Fresh weights; before it has learned, offsets are near 0 and deviations those of `anchors`.
  //   regresses: MultiPath-like, else CoverNet-like, whose covariance is that of the deviations
  //              until it is calibrated
  AnchorNetworks(const v1::ModelSpec& model, Anchors anchors, bool regresses, at::Device device,
                 at::Generator& generator);

  bool regresses() const { return regresses_; }
  at::Device device() const { return scenes_.device(); }
  const v1::ModelSpec& spec() const { return scenes_.spec(); }
  const at::Tensor& anchors() const { return anchors_; }

  // Relative to the scenes' references.
  AnchorPredictions Predict(const SceneTensors& scenes, const Networks::Mode& mode);

  // Backbone, classifier and regression.
  std::vector<at::Tensor> Parameters() const;

  // After learning. Divides the logits by `temperature`.
  void SetTemperature(double temperature);
  // CoverNet-like. [K, T, 3]
  void SetCovariance(const at::Tensor& covariance);
  // MultiPath-like: covariances times `scale` from now on. [T]
  void SetScale(const at::Tensor& scale);

  artifact::TensorMap Export() const;
  Networks::Snapshot Save() const;
  void Restore(const Networks::Snapshot& snapshot);

 private:
  Networks scenes_;  // of AnchorSpec
  const bool regresses_;
  const at::Tensor anchors_;    // [K, T, 2]
  const at::Tensor deviation_;  // [K, T, 2] what regressed offsets and deviations are relative to
  // anchors.covariance or anchors.scale, and anchor_regression.*
  std::map<std::string, at::Tensor> tensors_;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_ANCHORS_ANCHOR_NETWORKS_H_
