// The arithmetic of AdamW on plain numbers.

#ifndef MANEUVER_MODEL_LEARNING_KERNELS_ADAMW_STEP_H_
#define MANEUVER_MODEL_LEARNING_KERNELS_ADAMW_STEP_H_

#include <cstdint>

namespace maneuver::learning {

// AdamW's exponential averages (Loshchilov and Hutter, 2019) and what keeps it from dividing by 0.
inline constexpr double kBeta1 = 0.9;
inline constexpr double kBeta2 = 0.999;
inline constexpr double kEpsilon = 1e-8;

// What is the same for all numbers of a parameter.
struct AdamWStep {
  double rate = 0.0;
  double decay = 0.0;  // of the parameter, beside the gradient
  // 1 - beta^t: the averages began at 0.
  double correction1 = 1.0;
  double correction2 = 1.0;
};

// One step of a parameter's `count` numbers, in one pass over memory.
//   first, second: averages of the gradient and of its square
void TakeStep(const AdamWStep& step, int64_t count, const float* gradient, float* parameter,
              float* first, float* second);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_KERNELS_ADAMW_STEP_H_
