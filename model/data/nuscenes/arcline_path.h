// The centrelines of nuScenes' lanes: the arcline_path_3 of its map expansion.
//
// A path of three segments, each an arc or a straight line, that join without a kink: a Dubins
// path. Its shape names what each segment does: L turns left, R right, S runs straight. All arcs of
// a path have one radius r. With the curvature k = 1/r (L), -1/r (R) or 0 (S), a segment that
// begins at p with the heading h reaches after s metres
//
//   p(s) = p + s * sinc(k s / 2) * (cos(h + k s / 2), sin(h + k s / 2)),    h(s) = h + k s
//
// with sinc(u) = sin(u) / u: the chord of an arc points along its mean heading.

#ifndef MANEUVER_MODEL_DATA_NUSCENES_ARCLINE_PATH_H_
#define MANEUVER_MODEL_DATA_NUSCENES_ARCLINE_PATH_H_

#include <array>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "model/scene/pose2.h"

namespace maneuver::data {

struct ArclinePath {
  scene::Pose2 start;                  // map frame
  std::array<double, 3> curvatures{};  // 1/metre, counter-clockwise
  std::array<double, 3> lengths{};     // metres, >= 0

  double length() const { return lengths[0] + lengths[1] + lengths[2]; }
  // Returns the pose after `distance` metres, 0 .. length(). The heading may exceed pi.
  scene::Pose2 PoseAt(double distance) const;
};

// Returns the curvatures of a shape: LSL, LSR, RSL, RSR, LRL or RLR. INVALID_ARGUMENT for any other
// shape, and for a radius that is not positive.
absl::StatusOr<std::array<double, 3>> CurvaturesOf(std::string_view shape, double radius);

// Appends points of the path at equal distances of at most `resolution` metres, its two ends
// included. The first is left out if `points` ends within 1 cm of it.
void AppendPoints(const ArclinePath& path, double resolution, std::vector<scene::Point2>* points);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_NUSCENES_ARCLINE_PATH_H_
