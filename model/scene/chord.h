// Finds straight stretches of a polyline. The brush uses it to draw a road in as few segments as
// its shape needs, instead of as many as its map has. Private to the brush.

#ifndef MANEUVER_MODEL_SCENE_CHORD_H_
#define MANEUVER_MODEL_SCENE_CHORD_H_

#include <cstddef>

#include "model/scene/pixel_line.h"

namespace maneuver::scene {

// How far points may lie from the chord that leaves them out, pixels.
inline constexpr double kChordTolerance = 0.03;

// Returns the end of a chord that starts at point `start` of a line and passes all points in
// between within kChordTolerance: a long chord, but not always the longest. The result is at least
// start + 1 and at most `last`.
size_t ChordEnd(const PixelLine& line, size_t start, size_t last);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_CHORD_H_
