// Pools a set whose elements have no order: a weighted mean and a maximum.

#ifndef MANEUVER_MODEL_INFERENCE_SET_POOLING_H_
#define MANEUVER_MODEL_INFERENCE_SET_POOLING_H_

namespace maneuver::inference {

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

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_SET_POOLING_H_
