// The baselines in a model folder: predictors with fixed anchors that were trained with the model,
// on the same examples, for comparison. They lie beside model.json and weights.safetensors:
//
//   baselines.json          a ModelManifest: AnchorSpec, SHA-256 of the weights
//   baselines.safetensors   both baselines' tensors, "covernet/NAME" and "multipath/NAME"
//
// A folder without them is complete. Only evaluations read them.
//
// CoverNet-like (Phan-Minh et al., CVPR 2020): p(k|s) over K fixed trajectories. MultiPath-like
// (Chai et al., CoRL 2019): the same, plus an offset and a Gaussian for each anchor and waypoint.
// The anchors of both are k-means centres of training trajectories. Their tensors:
//
//   backbone.*, history.*, lane_path.*, agent.*, join.*, action_predictor.*
//                                      as in tensor.h, with K logits
//   anchors.mean                       [K, T, 2] metres, target frame, relative to the spec's
//                                      reference
//   covernet:   anchors.covariance     [K, T, 3] xx, xy, yy, square metres
//   multipath:  anchors.scale          [T] factor of the predicted covariances, positive
//               anchor_regression.{i}.{weight,bias}   F' -> the hidden layers of the action
//                   predictor -> K * T * 5: for each anchor and waypoint offset x, offset y
//                   (metres), ln sigma_x, ln sigma_y, correlation; see AnchorGaussian
//
// and the latent tensors of AnchorSpec, which have no meaning.

#ifndef MANEUVER_MODEL_ARTIFACT_ANCHOR_BASELINES_H_
#define MANEUVER_MODEL_ARTIFACT_ANCHOR_BASELINES_H_

#include <filesystem>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/tensor.h"

namespace maneuver::artifact {

// Maps the five regressed numbers to a Gaussian:
//   sigma = kSmallestSigma + exp(min(ln sigma, kLargestLogSigma)) metres,
//   correlation = kLargestCorrelation * tanh(correlation).
struct AnchorGaussian {
  static constexpr int kNumbers = 5;
  static constexpr double kSmallestSigma = 0.05;  // metres
  static constexpr double kLargestLogSigma = 5.0;
  static constexpr double kLargestCorrelation = 0.95;
};

struct StoredBaselines {
  v1::ModelSpec spec;   // AnchorSpec of the model that they were trained with
  TensorMap covernet;   // CoverNet-like
  TensorMap multipath;  // MultiPath-like
};

// Returns the spec of a model's baselines. They have the model's inputs, waypoints and reference.
// The latent parts, which the anchors replace, are as small as a spec allows. How the model decodes
// actions is left out.
v1::ModelSpec AnchorSpec(const v1::ModelSpec& model);

// Adds baselines to a model folder. INVALID_ARGUMENT for what ReadBaselines would refuse; errors of
// files.
absl::Status WriteBaselines(const std::filesystem::path& folder, const StoredBaselines& baselines);

// Reads the baselines of a folder. NOT_FOUND if it has none; DATA_LOSS with the reason if a file is
// missing, truncated, altered (SHA-256) or of another format version, or a tensor is missing, of
// another shape, not finite or no covariance.
absl::StatusOr<StoredBaselines> ReadBaselines(const std::filesystem::path& folder);

// Copies the baselines of one model folder to another, if there are any. A pruned model is still
// compared with the baselines of the whole one. Errors: those of reading and writing them.
absl::Status CopyBaselines(const std::filesystem::path& from, const std::filesystem::path& to);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_ANCHOR_BASELINES_H_
