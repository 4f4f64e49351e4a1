#include "model/inference/set_pooling.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace maneuver::inference {

void PoolSet(const float* elements, const float* scores, int count, SetShape shape, float* pooled) {
  using Channels = Eigen::Map<Eigen::ArrayXf>;
  using ConstChannels = Eigen::Map<const Eigen::ArrayXf>;
  Channels attended(pooled, shape.width);
  Channels maximum(pooled + shape.width, shape.width);
  attended.setZero();
  maximum.setZero();
  const int channels = shape.width / shape.heads;
  for (int head = 0; head < shape.heads && count > 0; ++head) {
    float largest = scores[head];
    for (int i = 1; i < count; ++i) largest = std::max(largest, scores[i * shape.heads + head]);
    Channels part(pooled + head * channels, channels);
    float sum = 0.0f;
    for (int i = 0; i < count; ++i) {
      const float weight = std::exp(scores[i * shape.heads + head] - largest);
      sum += weight;
      part += weight * ConstChannels(elements + i * shape.width + head * channels, channels);
    }
    part /= sum;
  }
  for (int i = 0; i < count; ++i) {
    maximum = maximum.max(ConstChannels(elements + i * shape.width, shape.width));
  }
}

}  // namespace maneuver::inference
