// The networks of a model as plain loops in double precision, from tensor.h alone: an independent
// second implementation that the engine is held against.

#ifndef MANEUVER_TESTS_UNIT_MODEL_INFERENCE_REFERENCE_MODEL_H_
#define MANEUVER_TESTS_UNIT_MODEL_INFERENCE_REFERENCE_MODEL_H_

#include <cstdint>
#include <string>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/model_folder.h"

namespace maneuver::inference {

// A model of random weights whose activations stay of order 1, with every part of it at work.
artifact::StoredModel RandomModel(const v1::ModelSpec& spec, uint32_t seed);

// A raster as sparse as real ones if the seed is odd; if it is even, one of which more is filled,
// which the engine convolves in another way.
std::vector<uint8_t> RandomRaster(const v1::ModelSpec& spec, uint32_t seed);

class ReferenceModel {
 public:
  explicit ReferenceModel(const artifact::StoredModel& model) : model_(model) {}

  using Values = std::vector<double>;
  Values Features(const std::vector<uint8_t>& raster) const;  // [F]
  Values Probabilities(const Values& features) const;         // [K]
  Values Posterior(const Values& features, int k) const;      // [2D] mean, log-variance
  Values EncodeTrajectory(const Values& x) const;             // [2T] -> [2D] mean, log-variance
  Values Decode(const Values& z) const;                       // [D] -> [2T] metres
  // q(y|x,s) of the unified model, by exponentiating and normalising in long double.
  Values Responsibilities(const Values& features, const Values& x) const;

 private:
  const std::vector<float>& Tensor(const std::string& name) const {
    return model_.weights.at(name).values;
  }
  Values Mlp(const std::string& name, int layers, Values x, int network = 0) const;

  const artifact::StoredModel& model_;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_TESTS_UNIT_MODEL_INFERENCE_REFERENCE_MODEL_H_
