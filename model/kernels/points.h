// Arithmetic on many points: projection, frames, ranges, chords. No product is fused with a sum, so
// each result has the same bits on every instruction set.

#ifndef MANEUVER_MODEL_KERNELS_POINTS_H_
#define MANEUVER_MODEL_KERNELS_POINTS_H_

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

// Sets for each point the sides of a picture that it lies beyond, one bit each: left 1, right 2,
// above 4, below 8.
//   reach: how far outside a point still counts as inside, pixels
//   u, v, sides: [count] and room for kPointLanes numbers more, which may be read and written
void FindSides(const double* u, const double* v, size_t count, int height, int width, double reach,
               int64_t* sides);

// Returns the end of a chord that starts at point `start` and passes all points before its end:
// they lie within `tolerance` of the chord, and none of them beyond its ends. The chord is long,
// but not always the longest. The result is at least start + 1 and at most `last`.
//   u, v: room for kPointLanes numbers behind point `last`, which may be read
size_t FindChordEnd(const double* u, const double* v, size_t start, size_t last, double tolerance);

// The smallest upright rectangle around points.
struct PointBox {
  double low_x, low_y, high_x, high_y;
};

// Finds the box of `count` points, at least one.
PointBox FindBox(const double* x, const double* y, size_t count);

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
