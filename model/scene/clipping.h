// Clips shapes to the picture. Private to the brush.

#ifndef MANEUVER_MODEL_SCENE_CLIPPING_H_
#define MANEUVER_MODEL_SCENE_CLIPPING_H_

#include <algorithm>
#include <cmath>

#include "model/scene/brush.h"

namespace maneuver::scene {

// Narrows [*enter, *leave], the parameters t of the line a + t (b - a), to where the coordinate
// lies within [low, high]. If it does nowhere, *leave is less than *enter.
inline void ClipParameter(double a, double b, double low, double high, double* enter,
                          double* leave) {
  const double change = b - a;
  if (change == 0.0) {
    if (a < low || a > high) *leave = -1.0;
    return;
  }
  double first = (low - a) / change;
  double last = (high - a) / change;
  if (first > last) std::swap(first, last);
  *enter = std::max(*enter, first);
  *leave = std::min(*leave, last);
}

inline PixelPoint Between(const PixelPoint& a, const PixelPoint& b, double t) {
  return {a.u + t * (b.u - a.u), a.v + t * (b.v - a.v)};
}

// Clamps to [0, limit] and maps NaN to 0, so that no input leads outside the picture.
inline double Limited(double value, int limit) {
  return std::min(std::max(0.0, value), static_cast<double>(limit));
}

// The pixels of a row or column of `size` that overlap [low, high]: the first, and one past the
// last.
struct PixelRange {
  PixelRange(double low, double high, int size)
      : first(static_cast<int>(std::floor(Limited(low, size)))),
        last(static_cast<int>(std::ceil(Limited(high, size)))) {}
  int first;
  int last;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_CLIPPING_H_
