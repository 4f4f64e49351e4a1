// The networks of a model as LibTorch tensors, by the names of artifact/tensor.h.
//
// LibTorch stays in model/learning/, so only its .cc files and tests may include this header.

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
#include "model/learning/scene_tensors.h"
#include "model/learning/tensors.h"
#include "model/scene/action_geometry.h"

namespace maneuver::learning {

// Returns the random numbers of a run. They are always drawn on the CPU, so a seed means the same
// on every device.
at::Generator MakeGenerator(uint64_t seed);

// Every tensor of a model and the functions they make. Not thread-safe.
class Networks {
 public:
  // Draws fresh weights: He initialisation for layers before a ReLU, and the mixture at N(0, I).
  // The last layer of the scenario encoders is small, so an untrained one gives the generic action.
  // The last batch normalisation of a residual block has gamma 0. Numbers of lane paths and agents
  // that a dataset may lack have weights 0, so that what is not learned has no effect.
  Networks(const v1::ModelSpec& spec, at::Device device, at::Generator& generator);

  const v1::ModelSpec& spec() const { return spec_; }
  at::Device device() const { return device_; }

  // How the networks are evaluated. While training, batch normalisation uses the batch's own
  // moments and updates the running ones, and a random share `dropout` of the features is dropped.
  // Otherwise neither happens.
  struct Mode {
    at::Generator* training = nullptr;  // set: training
    double dropout = 0.0;
    double geometry_dropout = 0.0;  // share of h_y that is dropped
  };

  // Evaluates everything that reads the scene: backbone, history, lane paths, agents, and how the
  // generic actions lie relative to the lanes. The latter gives the mixture and the decoder no
  // gradient.
  SceneFeatures EncodeScenes(const SceneTensors& scenes, const Mode& mode);
  // Returns ln p(y|s). [B, K]
  at::Tensor PredictActions(const SceneFeatures& scenes) const;
  // Returns q(z|x). trajectories [B, 2T] metres -> [B, D]
  Gaussian EncodeTrajectories(const at::Tensor& trajectories) const;
  // Returns the mean of p(x|z), a smooth curve (trajectory_basis.h), relative to the reference.
  //   latents: [..., D]
  //   residual: the scene's addition, from MeanResidual, [..., 2M]; undefined: none
  //   returns: [..., 2T] metres
  at::Tensor Decode(const at::Tensor& latents, const at::Tensor& residual = {}) const;
  // Returns W_y f(s) + W'_y h_y for a spec with mean_residual, otherwise an undefined tensor. [B,
  // K, 2M] coefficients in standard deviations
  at::Tensor MeanResidual(const SceneFeatures& scenes) const;
  // Returns the logarithms of the standard deviations along and across the mean of each action,
  // without the speed factors; for a spec with scene_covariance. [B, K, T, 2] ln metres
  at::Tensor PredictLogStddevs(const SceneFeatures& scenes) const;
  // Returns the covariance of p(x|z) for a spec whose covariance depends on z. [..., D] -> [..., T,
  // 3] xx, xy, yy, square metres
  at::Tensor PredictCovariance(const at::Tensor& latents) const;
  // Makes what depends on the scene in p(x|z,y,s) and q(z|y,s) add nothing, so that both are those
  // of the generic action, as in the base objective.
  void ZeroScenarioEncoders();
  // Makes p(y|s) = 0 for these actions from now on.
  void SwitchOff(std::span<const int> actions);
  // Returns q_1(z|s) .. q_K(z|s). They are computed relative to the mixture's components, which get
  // no gradient through them. [B, K, D]
  Gaussian EncodeScenarios(const SceneFeatures& scenes) const;
  // Returns p(z|y). [K, D]
  Gaussian Mixture() const;
  // Returns ln p(y) without a scenario, normalised. [K]
  at::Tensor MixtureLogWeights() const;

  // Sets the means and deviations by which the networks standardise trajectories.
  //   trajectories: [N, 2T] metres
  //   mirrored: left and right are swapped at random, so the mean has no lateral part
  void Standardize(const at::Tensor& trajectories, bool mirrored);

  // Returns a tensor by its name in artifact/tensor.h; it must exist. In the decoder's last layer
  // the rows are coefficients [2M] and not yet positions [2T].
  at::Tensor& operator[](const std::string& name);
  const at::Tensor& operator[](const std::string& name) const;

  // The parts that a phase can train.
  enum class Part {
    kTrajectoryEncoder,
    kDecoder,
    kMixture,
    kScene,  // all that reads scenes: backbone, history, lane paths, geometry
    kActions,
    kScenarioEncoder,  // and the other layers of p(x|z,y,s) that read the scene
    kDecoderCovariance,
    kSceneCovariance
  };
  std::vector<at::Tensor> Parameters(Part part) const;
  // Returns for each of these parameters whether weight decay applies to it. It applies to the
  // weights of layers. Biases, normalisations and the mixture do not decay, also where they have a
  // row for each action.
  std::vector<bool> Decays(Part part) const;
  // Returns the running moments of the batch normalisations.
  std::vector<at::Tensor> RunningMoments() const;

  // Returns copies for the model folder: ln p(y) is normalised, and the decoder's last layer is
  // multiplied by the basis.
  artifact::TensorMap Export() const;
  // Sets the parameters from weights that Export returned for the same spec, to within rounding.
  // Keeps the standard deviations of coefficients that Standardize found.
  void Import(const artifact::TensorMap& weights);

  // Save returns copies of all tensors, learned or not, and Restore puts them back. Neither touches
  // the coefficients' standard deviations (Standardize).
  using Snapshot = std::map<std::string, at::Tensor>;
  Snapshot Save() const;
  void Restore(const Snapshot& snapshot);

 private:
  // Returns the names of the learned tensors of a part, in ascending order.
  std::vector<std::string> NamesOf(Part part) const;
  // Evaluates the backbone: rasters -> the last grid [B, C', h, w].
  at::Tensor EvaluateBackbone(const RasterBatch& rasters, bool training);
  // Evaluates the perceptron `name`.
  at::Tensor Mlp(const std::string& name, const v1::MlpSpec& mlp, at::Tensor x) const;
  // Evaluates K perceptrons `name` side by side. features [B, F'] -> [K, B, out]
  at::Tensor PerAction(const std::string& name, const v1::MlpSpec& mlp,
                       const at::Tensor& features) const;
  // Returns joint features of history, lane paths, agents and raster. Writes l_i, [B, paths, P], to
  // `lane_paths`.
  at::Tensor ReadScenes(const SceneTensors& scenes, const Mode& mode, at::Tensor* lane_paths);
  // Returns h_y. lane_paths: l_i;  features: [B, F'] -> [B, K, A]
  at::Tensor EncodeActionGeometry(const SceneTensors& scenes, const at::Tensor& lane_paths,
                                  const at::Tensor& features) const;
  // Evaluates the layer `name`, [..., in] -> [..., out].
  at::Tensor Dense(const std::string& name, const at::Tensor& x) const;
  at::Tensor Drop(const at::Tensor& values, double share, at::Generator& generator) const;
  // Returns the linear map from the decoder's last layer to positions relative to the mean. [2T,
  // 2M]
  at::Tensor CurveMap() const;

  v1::ModelSpec spec_;
  at::Device device_;
  const std::vector<artifact::BackboneLayer> backbone_;
  const std::string last_decoder_layer_;  // "decoder.3"
  at::Tensor basis_;                      // [T, M]
  at::Tensor coefficient_stddev_;         // [M, 2] metres
  at::Tensor stddev_terms_;               // of scene_covariance, [T, 4]
  const scene::GeometryWaypoints geometry_waypoints_;
  std::map<std::string, at::Tensor> tensors_;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_NETWORKS_H_
