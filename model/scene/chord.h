// Straight stretches of a polyline, for the brush alone: a road is drawn in as few segments as its
// shape needs, not in as many as its map has.

#ifndef MANEUVER_MODEL_SCENE_CHORD_H_
#define MANEUVER_MODEL_SCENE_CHORD_H_

#include <cstddef>
#include <span>

#include "model/scene/brush.h"

namespace maneuver::scene {

// How far points may lie from the chord that leaves them out, pixels.
inline constexpr double kChordTolerance = 0.03;

// The end of a chord that starts at points[0] and passes all points before its end within
// kChordTolerance: a long one, if not always the longest. At least 1.
//   points: at least two.
size_t ChordEnd(std::span<const PixelPoint> points);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_CHORD_H_
