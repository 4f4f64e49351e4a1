// The networks of a model as LibTorch tensors, by the names of artifact/tensor.h.
//
// LibTorch stays in model/learning/: this header is for its .cc files and tests alone.

#ifndef MANEUVER_MODEL_LEARNING_NETWORKS_H_
#define MANEUVER_MODEL_LEARNING_NETWORKS_H_

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/backbone_layers.h"
#include "model/artifact/tensor.h"
#include "model/learning/gaussian.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Random numbers of one run, on the CPU whatever the device, so that a seed means the same on both.
at::Generator MakeGenerator(uint64_t seed);

// Every tensor of a model and the functions they make. Not thread-safe.
class Networks {
 public:
  // Fresh weights: He initialisation for layers before a ReLU, the last layer of the scenario
  // encoders small (an untrained one answers the generic action), the mixture at N(0, I). The last
  // batch normalisation of a residual block has gamma 0.
  Networks(const v1::ModelSpec& spec, at::Device device, at::Generator& generator);

  const v1::ModelSpec& spec() const { return spec_; }
  at::Device device() const { return device_; }

  // While training, batch normalisation uses (and follows) the batch's own moments, and a share
  // `dropout` of the features, drawn from `training`, is taken away; otherwise neither.
  struct Mode {
    at::Generator* training = nullptr;  // set: training
    double dropout = 0.0;
  };

  // The backbone.
  //   rasters: [B, H, W, C] bytes
  //   motions: [B, scene::kMotionInputs]; not looked at if the spec does not ask for it
  //   returns: features [B, F'], see artifact::SceneFeatures
  at::Tensor EncodeScenes(const at::Tensor& rasters, const at::Tensor& motions, const Mode& mode);
  // ln p(y|s). features [B, F'] -> [B, K]
  at::Tensor PredictActions(const at::Tensor& features) const;
  // q(z|x). trajectories [B, 2T] metres -> [B, D]
  Gaussian EncodeTrajectories(const at::Tensor& trajectories) const;
  // Mean of p(x|z), a smooth curve (trajectory_basis.h). latents [..., D] -> [..., 2T] metres
  at::Tensor Decode(const at::Tensor& latents) const;
  // Covariance of p(x|z) of a spec that has it depend on z. [..., D] -> [..., T, 3] xx, xy, yy,
  // square metres
  at::Tensor PredictCovariance(const at::Tensor& latents) const;
  // Of the base objective, whose q(z|y,s) is the generic action: scenario encoders that add
  // nothing.
  void SilenceScenarioEncoders();
  // p(y|s) = 0 for these actions from now on.
  void SwitchOff(std::span<const int> actions);
  // q_1(z|s) .. q_K(z|s), relative to the mixture's components, which get no gradient through it.
  // features [B, F'] -> [B, K, D]
  Gaussian EncodeScenarios(const at::Tensor& features) const;
  // p(z|y). [K, D]
  Gaussian Mixture() const;
  // ln p(y) without a scenario, normalised. [K]
  at::Tensor MixtureLogWeights() const;

  // Sets the means and deviations that networks see trajectories relative to.
  //   trajectories: [N, 2T] metres
  //   mirrored: left and right are swapped at random, so that there is no mean to the side
  void Standardize(const at::Tensor& trajectories, bool mirrored);

  // A tensor by its name in artifact/tensor.h; it must exist. Of the decoder's last layer, the rows
  // are coefficients [2M] and not yet positions [2T].
  at::Tensor& operator[](const std::string& name);
  const at::Tensor& operator[](const std::string& name) const;

  // What a phase trains.
  enum class Part {
    kTrajectoryEncoder,
    kDecoder,
    kMixture,
    kBackbone,
    kActions,
    kScenarioEncoder,
    kDecoderCovariance
  };
  std::vector<at::Tensor> Parameters(Part part) const;

  // Copies for the model folder: ln p(y) normalised, the decoder's last layer times the basis.
  artifact::TensorMap Export() const;
  // The inverse, to within rounding, of weights of the same spec; the deviations that Standardize
  // found of coefficients stay.
  void Import(const artifact::TensorMap& weights);

  // Copies of all that is learned, and back.
  using Snapshot = std::map<std::string, at::Tensor>;
  Snapshot Save() const;
  void Restore(const Snapshot& snapshot);

 private:
  // rasters [B, H, W, C] bytes, to the last grid [B, C', h, w]
  at::Tensor EvaluateBackbone(const at::Tensor& rasters, bool training);
  at::Tensor Mlp(const std::string& name, size_t layers, at::Tensor x) const;
  at::Tensor PerAction(const at::Tensor& features) const;
  // The linear map from the decoder's last layer to positions relative to the mean. [2T, 2M]
  at::Tensor CurveMap() const;

  v1::ModelSpec spec_;
  at::Device device_;
  const std::vector<artifact::BackboneLayer> backbone_;
  const std::string last_decoder_layer_;  // "decoder.3"
  at::Tensor basis_;                      // [T, M]
  at::Tensor coefficient_stddev_;         // [M, 2] metres
  std::map<std::string, at::Tensor> tensors_;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_NETWORKS_H_
