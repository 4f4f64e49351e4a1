// The networks of a model as plain loops in double precision, written from tensor.h alone: an
// independent second implementation that tests compare the engine with.

#ifndef MANEUVER_TESTS_UNIT_MODEL_INFERENCE_REFERENCE_MODEL_H_
#define MANEUVER_TESTS_UNIT_MODEL_INFERENCE_REFERENCE_MODEL_H_

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/model_folder.h"
#include "model/scene/scene_vectors.h"

namespace maneuver::inference {

// A model of random weights whose activations stay of order 1, with every part of it at work.
artifact::StoredModel RandomModel(const v1::ModelSpec& spec, uint32_t seed);

// Returns a raster that is as sparse as real ones if the seed is odd. If the seed is even, more of
// it is nonzero, and the engine convolves it in another way.
std::vector<uint8_t> RandomRaster(const v1::ModelSpec& spec, uint32_t seed);

// A target that moves at up to 20 m/s among `paths` straight lane paths, some with a leader or a
// stop line; whatever else the networks read of it is random, as are the numbers of `agents`
// agents.
scene::SceneVectors RandomVectors(uint32_t seed, int paths, int agents);

class ReferenceModel {
 public:
  explicit ReferenceModel(const artifact::StoredModel& model) : model_(model) {}

  using Values = std::vector<double>;
  using Rows = std::vector<Values>;

  // What a scene gives the networks. h_y and paths are empty for models that do not have them.
  struct Scene {
    Values features{};   // [F']
    Rows geometry{};     // [K, A] h_y
    Values reference{};  // [2T] metres
    double speed = 0.0;  // m/s
  };

  // [F] of the backbone.
  Values Features(const std::vector<uint8_t>& raster) const;
  // Encodes a scene for a model with scene vectors.
  //   raster_features: of the backbone; empty without a raster
  Scene Encode(const scene::SceneVectors& vectors, const Values& raster_features) const;

  Values Probabilities(const Scene& scene) const;     // [K]
  Values Posterior(const Scene& scene, int k) const;  // [2D] mean, log-variance
  Values EncodeTrajectory(const Values& x) const;     // [2T] -> [2D] mean, log-variance
  Values Decode(const Values& z) const;               // [D] -> [2T] metres, without a reference
  Values MeanResidual(const Scene& scene,
                      int k) const;  // [2T] metres, added to what Decode answers
  // q(y|x,s) of the unified model, by exponentiating and normalising in long double.
  Values Responsibilities(const Scene& scene, const Values& x) const;
  // The covariance that the scene predicts for action k at each waypoint. [T][xx, xy, yy]
  //   mean: [2T] metres, with the reference
  Rows SceneCovariance(const Scene& scene, int k, const Values& mean) const;

 private:
  const std::vector<float>& Tensor(const std::string& name) const {
    return model_.weights.at(name).values;
  }
  const std::vector<int64_t>& Shape(const std::string& name) const {
    return model_.weights.at(name).shape;
  }
  const v1::ModelSpec& spec() const { return model_.manifest.spec(); }
  Values Mlp(const std::string& name, int layers, Values x, int network = 0) const;
  // `name`.weight times x, plus `name`.bias if there is one.
  Values Linear(const std::string& name, const Values& x, int network = 0) const;
  // Attended, then maximum, over elements whose scores are `name`.attention. [2 width]
  Values Pool(const std::string& name, const Rows& elements, int heads, size_t width) const;
  // What is known of each element of a set, l_i of lane paths.
  //   inputs: [count, numbers]
  Rows Elements(const std::string& name, std::span<const float> inputs, int count,
                const Values& own) const;
  Rows Geometry(const scene::SceneVectors& vectors, const Scene& scene, const Rows& paths) const;

  const artifact::StoredModel& model_;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_TESTS_UNIT_MODEL_INFERENCE_REFERENCE_MODEL_H_
