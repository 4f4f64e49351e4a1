// The future of an agent as a model predicts it: positions at the waypoint times.

#ifndef MANEUVER_MODEL_DATA_TRAJECTORY_H_
#define MANEUVER_MODEL_DATA_TRAJECTORY_H_

#include <span>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/scene/pose2.h"

namespace maneuver::data {

// Clocks jitter: a waypoint less than this many seconds after the last state, or before the first,
// takes that state's position. At 30 m/s the error is 6 cm.
inline constexpr double kClockTolerance = 0.002;

// Resamples the positions of `agent` in the frame X_WT at `time` + each waypoint time, by linear
// interpolation between states.
//   waypoint_times: [T] seconds after `time`.
//   trajectory: [T, 2] metres, x then y.
// Returns false if a waypoint lies outside the states or in a gap longer than `max_gap` seconds.
// Then sets *missing, if given, to the index of the first such waypoint, and does not write the
// rest of `trajectory`.
bool ResampleFuture(const v1::Agent& agent, double time, const scene::Pose2& X_WT,
                    std::span<const double> waypoint_times, double max_gap,
                    std::span<double> trajectory, int* missing = nullptr);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_TRAJECTORY_H_
