#include "model/scene/chord.h"

#include "model/kernels/points.h"

namespace maneuver::scene {

size_t ChordEnd(const PixelLine& line, size_t start, size_t last) {
  return kernels::FindChordEnd(line.u(), line.v(), start, last, kChordTolerance);
}

}  // namespace maneuver::scene
