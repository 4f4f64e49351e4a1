// What of a shape lies in the picture; for the brush alone.

#ifndef MANEUVER_MODEL_SCENE_CLIPPING_H_
#define MANEUVER_MODEL_SCENE_CLIPPING_H_

#include <algorithm>
#include <cmath>

#include "model/scene/brush.h"

namespace maneuver::scene {

// Narrows [*enter, *leave], parameters of a + t (b - a), to where the coordinate lies within
// [low, high].
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

// Within [0, limit]; 0 for what is not a number, so that no input leads outside the picture.
inline double Limited(double value, int limit) {
  return std::min(std::max(0.0, value), static_cast<double>(limit));
}

// First and one past the last pixel of `size` whose extent meets [low, high].
struct PixelRange {
  PixelRange(double low, double high, int size)
      : first(static_cast<int>(std::floor(Limited(low, size)))),
        last(static_cast<int>(std::ceil(Limited(high, size)))) {}
  int first;
  int last;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_CLIPPING_H_
