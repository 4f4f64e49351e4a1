#include "model/learning/kernels/adamw_step.h"

#include <cmath>

namespace maneuver::learning {

void TakeStep(const AdamWStep& step, int64_t count, const float* __restrict gradient,
              float* __restrict parameter, float* __restrict first, float* __restrict second) {
  constexpr auto kGain1 = static_cast<float>(1.0 - kBeta1);
  constexpr auto kKeep2 = static_cast<float>(kBeta2);
  constexpr auto kGain2 = static_cast<float>(1.0 - kBeta2);
  constexpr auto kLeast = static_cast<float>(kEpsilon);
  const auto kept = static_cast<float>(1.0 - step.rate * step.decay);
  const auto rate = static_cast<float>(step.rate / step.correction1);
  const auto scale = static_cast<float>(1.0 / std::sqrt(step.correction2));
  for (int64_t i = 0; i < count; ++i) {
    const float g = gradient[i];
    const float m = first[i] + kGain1 * (g - first[i]);
    const float v = kKeep2 * second[i] + kGain2 * (g * g);
    first[i] = m;
    second[i] = v;
    parameter[i] = kept * parameter[i] - rate * m / (std::sqrt(v) * scale + kLeast);
  }
}

}  // namespace maneuver::learning
