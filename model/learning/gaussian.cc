#include "model/learning/gaussian.h"

#include <cmath>
#include <numbers>

namespace maneuver::learning {

at::Tensor Divergence(const Gaussian& q, const Gaussian& p) {
  const at::Tensor ratio = (q.log_variance - p.log_variance).exp();
  const at::Tensor offset = (q.mean - p.mean).square() * (-p.log_variance).exp();
  return 0.5 * (p.log_variance - q.log_variance + ratio + offset - 1.0).sum(-1);
}

at::Tensor CrossEntropy(const Gaussian& q, const Gaussian& p) {
  const at::Tensor spread = q.log_variance.exp() + (q.mean - p.mean).square();
  return 0.5 *
         (std::log(2.0 * std::numbers::pi) + p.log_variance + spread * (-p.log_variance).exp())
             .sum(-1);
}

at::Tensor Sample(const Gaussian& q, const at::Tensor& noise) {
  return q.mean + (0.5 * q.log_variance).exp() * noise;
}

Gaussian StandardNormal(int64_t dimensions, at::Device device) {
  const at::TensorOptions options = at::TensorOptions(at::kFloat).device(device);
  return {at::zeros({dimensions}, options), at::zeros({dimensions}, options)};
}

}  // namespace maneuver::learning
