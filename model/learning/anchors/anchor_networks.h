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

// The anchors, and how far examples deviate from their own anchor.
struct Anchors {
  at::Tensor mean;       // a_k, [K, T, 2] metres
  at::Tensor deviation;  // root mean square of x - a_k over a cluster, [K, T, 2] metres, positive
};

// Places anchors by k-means in metres on at most 16,384 of the trajectories, drawn evenly.
//   trajectories: [N, 2T] metres, on the CPU;  N >= K
//   mirrored: also uses the mirror image of each, as learning does
Anchors PlaceAnchors(const at::Tensor& trajectories, int anchors, bool mirrored, uint64_t seed);

// Returns the anchor with the smallest mean squared distance to each trajectory.
//   trajectories: [B, 2T] metres;  returns: [B] indices
at::Tensor NearestAnchor(const at::Tensor& anchors, const at::Tensor& trajectories);

// What a baseline predicts for B scenes.
struct AnchorPredictions {
  at::Tensor log_probabilities;  // ln p(k|s), [B, K]
  at::Tensor mean;               // a_k + mu_k(s), [B, K, T, 2] metres
  at::Tensor covariance;         // Sigma_k(s), [B, K, T, 3] xx, xy, yy, square metres
};

// Returns -ln p(k^|s), [B], where k^ is the nearest anchor: CoverNet's loss (Phan-Minh et al., CVPR
// 2020, section 3.3).
at::Tensor ClassifierLoss(const AnchorPredictions& predictions, const at::Tensor& nearest);

// Returns MultiPath's imitation loss, [B] (Chai et al., CoRL 2019, equation 3), with hard
// assignment:
//   -ln p(k^|s) - sum_t ln N(x_t | a_k^t + mu_k^t(s), Sigma_k^t(s)).
at::Tensor MultiPathLoss(const AnchorPredictions& predictions, const at::Tensor& nearest,
                         const at::Tensor& trajectories);

// Converts the last dimension from the numbers of AnchorGaussian (ln sigma_x, ln sigma_y,
// correlation) to xx, xy, yy. [.., 3]
at::Tensor AnchorCovariance(const at::Tensor& numbers);

// One baseline. Not thread-safe.
class AnchorNetworks {
 public:
  // Draws fresh weights. Before learning, offsets are near 0 and deviations are those of `anchors`.
  //   regresses: true: MultiPath-like. false: CoverNet-like; its covariance is that of the
  //     deviations until it is calibrated.
  AnchorNetworks(const v1::ModelSpec& model, Anchors anchors, bool regresses, at::Device device,
                 at::Generator& generator);

  bool regresses() const { return regresses_; }
  at::Device device() const { return scenes_.device(); }
  const v1::ModelSpec& spec() const { return scenes_.spec(); }
  const at::Tensor& anchors() const { return anchors_; }

  // Predicts trajectories relative to the scenes' references.
  AnchorPredictions Predict(const SceneTensors& scenes, const Networks::Mode& mode);

  // Returns the parameters of backbone, classifier and regression.
  std::vector<at::Tensor> Parameters() const;

  // Divides the logits by `temperature` from now on. Call after learning.
  void SetTemperature(double temperature);
  // Sets the covariance of a CoverNet-like baseline. [K, T, 3]
  void SetCovariance(const at::Tensor& covariance);
  // Multiplies the covariances of a MultiPath-like baseline by `scale` from now on. [T]
  void SetScale(const at::Tensor& scale);

  // Returns the tensors as an engine reads them (artifact/anchor_baselines.h).
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
