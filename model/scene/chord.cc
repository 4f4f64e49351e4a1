#include "model/scene/chord.h"

#include <algorithm>

#include "model/scene/lanes.h"

namespace maneuver::scene {
namespace {

// Whether the chord from point `start` to point `end` passes all points between them: that they lie
// near it, and beside it rather than before or beyond it.
bool Passes(const PixelLine& line, size_t start, size_t end) {
  const PixelPoint from = line[start];
  const double du = line[end].u - from.u;
  const double dv = line[end].v - from.v;
  const double squared = du * du + dv * dv;
  constexpr double kFarthest = kChordTolerance * kChordTolerance;
  const bool is_point = squared <= kFarthest;  // has no beside
  const double farthest = kFarthest * squared;
  for (size_t i = start + 1; i < end; i += kPointLanes) {
    const DoubleLanes off_u = line.U(i) - from.u;
    const DoubleLanes off_v = line.V(i) - from.v;
    const DoubleLanes across = off_u * dv - off_v * du;
    const DoubleLanes along = off_u * du + off_v * dv;
    MaskLanes missed = (across * across > farthest) | (along < 0.0) | (along > squared);
    if (is_point) missed = off_u * off_u + off_v * off_v > kFarthest;
    const auto left = static_cast<int64_t>(end - i);
    if (AnyOf(missed & (kPointIndex < left))) return false;
  }
  return true;
}

}  // namespace

size_t ChordEnd(const PixelLine& line, size_t start, size_t last) {
  // Twice as far for as long as it goes; then half as far from where it went, and so on.
  size_t end = start + 1;
  size_t step = 7;
  while (end < last && Passes(line, start, std::min(end + step, last))) {
    end = std::min(end + step, last);
    step = end - start;
  }
  for (step = std::min(step, last - end) / 2; step > 0; step /= 2) {
    if (Passes(line, start, end + step)) end += step;
  }
  return end;
}

}  // namespace maneuver::scene
