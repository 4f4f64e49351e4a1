// Straight stretches of a polyline, for the brush alone: a road is drawn in as few segments as its
// shape needs, not in as many as its map has.

#ifndef MANEUVER_MODEL_SCENE_CHORD_H_
#define MANEUVER_MODEL_SCENE_CHORD_H_

#include <cstddef>

#include "model/scene/pixel_line.h"

namespace maneuver::scene {

// How far points may lie from the chord that leaves them out, pixels.
inline constexpr double kChordTolerance = 0.03;

// The end of a chord that starts at a line's point `start` and passes all points before its end
// within kChordTolerance: a long one, if not always the longest. At least start + 1, at most
// `last`.
size_t ChordEnd(const PixelLine& line, size_t start, size_t last);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_CHORD_H_
