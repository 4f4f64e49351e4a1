// Arithmetic on sets whose elements have no order, such as the lane paths of a scene. No product is
// fused with a sum, so each result has the same bits on every instruction set.

#ifndef MANEUVER_MODEL_KERNELS_SET_POOLING_H_
#define MANEUVER_MODEL_KERNELS_SET_POOLING_H_

namespace maneuver::kernels {

struct SetShape {
  int width;  // channels of an element
  int heads;  // a divisor of width
};

// Writes the attended and the largest value of each channel over `count` elements, as
// artifact/tensor.h defines them for lane_path and action_geometry. Both are 0 if there is no
// element.
//   elements: [count, width], none below 0
//   scores: [count, heads]; the softmax of a column gives the weights of that head's channels
//   pooled: [2 * width] attended, then maximum
void PoolSet(const float* elements, const float* scores, int count, SetShape shape, float* pooled);

// Sets y = max(0, (y + a) + b), for `count` numbers.
void AddTwoAndRectify(const float* a, const float* b, int count, float* y);

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_SET_POOLING_H_
