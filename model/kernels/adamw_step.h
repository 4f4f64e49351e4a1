// The arithmetic of AdamW on plain numbers.

#ifndef MANEUVER_MODEL_KERNELS_ADAMW_STEP_H_
#define MANEUVER_MODEL_KERNELS_ADAMW_STEP_H_

#include <cmath>
#include <cstdint>

namespace maneuver::kernels {

// The factors of AdamW's exponential averages (Loshchilov and Hutter, 2019), and the constant that
// prevents a division by 0.
inline constexpr double kBeta1 = 0.9;
inline constexpr double kBeta2 = 0.999;
inline constexpr double kEpsilon = 1e-8;

// What all numbers of a parameter share.
struct AdamWStep {
  double rate = 0.0;
  double decay = 0.0;  // weight decay: a step multiplies the parameter by 1 - rate * decay
  // 1 - beta^t, because the averages began at 0.
  double correction1 = 1.0;
  double correction2 = 1.0;
};

// The same values in the form that the loop needs.
struct AdamWFactors {
  explicit AdamWFactors(const AdamWStep& step)
      : kept(static_cast<float>(1.0 - step.rate * step.decay)),
        rate(static_cast<float>(step.rate / step.correction1)),
        scale(static_cast<float>(1.0 / std::sqrt(step.correction2))) {}

  static constexpr auto kGain1 = static_cast<float>(1.0 - kBeta1);
  static constexpr auto kKeep2 = static_cast<float>(kBeta2);
  static constexpr auto kGain2 = static_cast<float>(1.0 - kBeta2);
  static constexpr auto kLeast = static_cast<float>(kEpsilon);
  float kept;   // factor of the parameter: its decay
  float rate;   // including the first average's correction
  float scale;  // the second average's correction, applied to its root
};

// Takes one step of a parameter's `count` numbers, in one pass over memory. All instruction sets
// give the same bits.
//   first, second: averages of the gradient and of its square
void TakeStep(const AdamWStep& step, int64_t count, const float* gradient, float* parameter,
              float* first, float* second);

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_ADAMW_STEP_H_
