// Arithmetic on many points: projection, frames, boxes, chords. No product is fused with a sum, so
// each result has the same bits on every instruction set.

#ifndef MANEUVER_MODEL_KERNELS_POINTS_H_
#define MANEUVER_MODEL_KERNELS_POINTS_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

namespace maneuver::kernels {

// Points are processed four at a time. Arrays that say so have room for this many numbers after the
// last one.
inline constexpr size_t kPointLanes = 4;

// Returns whether each value lies within [-limit, limit]; NaN does not.
bool AllWithin(std::span<const double> values, double limit);

// A view of the world: u = origin_u + scale (c dx + s dy), v = origin_v - scale (-s dx + c dy),
// where (dx, dy) is the point minus (x, y).
struct PointView {
  double x, y;
  double cosine, sine;  // c, s
  double scale;         // pixels per metre
  double origin_u, origin_v;
};

// Projects `count` points.
void ProjectPoints(const PointView& view, const double* x, const double* y, size_t count, double* u,
                   double* v);

// A rigid motion: x' = x + c px - s py, y' = y + s px + c py.
struct PointMotion {
  double x, y;
  double cosine, sine;  // c, s
};

// Moves `count` points.
//   points: [count, 2];  x, y: [count]
void MovePoints(const PointMotion& motion, const double* points, size_t count, double* x,
                double* y);

// The part of the plane that a picture shows.
struct PictureArea {
  int height, width;  // pixels
  double reach;       // how far outside a point still counts as inside, pixels
};

// A straight line from point `first` to point `last` of a line.
struct Chord {
  uint32_t first, last;
};

// Finds the chords of a line that may show in a picture, in their order. A chord passes all points
// between its ends: they lie within `tolerance` of it, and none of them beyond its ends. Chords are
// long, but not always the longest. Two neighbouring points beyond the same side of the picture are
// on no chord together. Returns how many there are.
//   u, v, sides: [count] and room for kPointLanes numbers more, which may be read and written
//   sides: scratch
//   chords: room for count
size_t FindChords(const double* u, const double* v, size_t count, const PictureArea& picture,
                  double tolerance, int64_t* sides, Chord* chords);

// The smallest upright rectangle around points.
struct PointBox {
  double low_x, low_y, high_x, high_y;

  bool Overlaps(const PointBox& other) const {
    return low_x <= other.high_x && other.low_x <= high_x && low_y <= other.high_y &&
           other.low_y <= high_y;
  }
  // Returns the box around both.
  PointBox With(const PointBox& other) const {
    return {std::min(low_x, other.low_x), std::min(low_y, other.low_y),
            std::max(high_x, other.high_x), std::max(high_y, other.high_y)};
  }
};

// `count` points of a line or an outline.
struct PointLine {
  const double* x;
  const double* y;
  size_t count;
};

// Finds the box of each line. That of no points has infinite bounds, the low ones above the high
// ones. Returns whether all coordinates are finite; if not, the boxes have no meaning.
//   boxes: [lines]
bool FindBoxes(std::span<const PointLine> lines, PointBox* boxes);

// The extent of the points of a piece of a line.
struct PointSpread {
  double low_x, low_y, high_x, high_y;
  double across_squared;  // the largest square of the cross product with the chord of its ends
  double chord_squared;   // the chord's length, squared
  bool astray;            // whether any point lies beyond one of the chord's ends
};

// Finds the spread of each piece of a line of `count` points. A piece has `intervals` intervals,
// the last one possibly fewer; neighbouring pieces share a point. One point is one piece.
//   spreads: as many as there are pieces, SpreadsOf(count, intervals)
void FindSpreads(const double* x, const double* y, int count, int intervals, PointSpread* spreads);
inline int SpreadsOf(int count, int intervals) {
  return count < 2 ? count : (count - 2) / intervals + 1;
}

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_POINTS_H_
