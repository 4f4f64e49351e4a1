// Velocities from positions alone.
//
// Argoverse 1 states where the centre of an object is, ten times a second, and nothing else. A
// difference of two positions would turn their noise into fourteen times as many metres per second.
// So a polynomial in time is fitted to the recent positions by least squares, separately along x
// and y, and its slope now is the velocity.
//
// With sixteen positions of independent noise sigma along each axis, the velocity has a noise of
// 2.06 sigma per second along each axis: 0.2 m/s for 0.1 m. The heading then has a noise of
// 2.06 sigma / speed, in radians.

#ifndef MANEUVER_MODEL_DATA_ARGOVERSE_MOTION_FIT_H_
#define MANEUVER_MODEL_DATA_ARGOVERSE_MOTION_FIT_H_

#include <span>
#include <vector>

#include "model/scene/pose2.h"

namespace maneuver::data {

// Positions further apart in time than this are not fitted together, seconds: one of ten a second
// may be missing, two may not.
inline constexpr double kMaxFitGap = 0.25;

// Returns the velocity at each time, metres per second.
//   times: [N] seconds, strictly increasing
//   positions: [N] metres
// Fits a parabola to the positions of the last 1.5 s, or a line while there is less than one second
// of them. Reads nothing later, so that the velocity tells no more about the future than the
// positions do. The only exception is the first half second after the beginning or after a gap: the
// line through that half second holds for all of it. A position alone between two gaps has
// velocity 0.
std::vector<scene::Point2> FitVelocities(std::span<const double> times,
                                         std::span<const scene::Point2> positions);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_ARGOVERSE_MOTION_FIT_H_
