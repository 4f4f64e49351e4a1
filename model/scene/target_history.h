// The target's last second as vectors: inputs of the networks, and an estimate of its present
// motion.

#ifndef MANEUVER_MODEL_SCENE_TARGET_HISTORY_H_
#define MANEUVER_MODEL_SCENE_TARGET_HISTORY_H_

#include <array>
#include <cstdint>

#include "maneuver/v1/scenario.pb.h"
#include "model/scene/pose2.h"

namespace maneuver::scene {

inline constexpr int kHistoryStates = 11;        // at -1.0, -0.9 .. 0 s
inline constexpr double kHistoryInterval = 0.1;  // seconds

// Where the target was, in its own frame at the prediction time.
struct PastState {
  double x = 0.0;           // metres
  double y = 0.0;           // metres
  double heading = 0.0;     // radians, without jumps of 2 pi
  double velocity_x = 0.0;  // m/s
  double velocity_y = 0.0;  // m/s
};

struct TargetHistory {
  std::array<PastState, kHistoryStates> states;  // oldest first
  double length = 0.0;                           // of the box, metres
  double width = 0.0;                            // of the box, metres
};

// Returns an agent's history until `time` in the frame X_WT. Interpolates linearly between recorded
// states. Uses no states that are more than `oldest` seconds old. Before the oldest state that it
// uses and after the latest one, it assumes constant velocity and heading. Reads nothing later than
// `time` (+ kSameTime).
TargetHistory ResampleHistory(const v1::Agent& agent, double time, const Pose2& X_WT,
                              double oldest = 1.0);

// The target's motion at the prediction time, estimated from its history.
//
// Acceleration a and turn rate w are the slopes of straight lines fitted to the 11 speeds along the
// body and to the 11 headings. Each slope is shrunk according to the noise of its fit, so that a
// noisy track falls back to constant velocity:
//
//   acceleration = a / (1 + 30 s^2 / 1.1)              s^2, q^2: residual variances of the fits,
//   turn_rate    = w / (1 + 100 q^2 / (1.1 * 0.12^2))  over 9 degrees of freedom
//
// The times of the 11 states, about their mean, have squares that add up to 1.1 (square seconds).
// So s^2 / 1.1 is the variance of the slope.
struct MotionEstimate {
  double speed = 0.0;           // along the heading, m/s; negative: backwards
  double lateral_speed = 0.0;   // to the left, m/s
  double acceleration = 0.0;    // m/s^2
  double turn_rate = 0.0;       // rad/s, counter-clockwise
  double speed_change = 0.0;    // over the last half second, m/s
  double earlier_change = 0.0;  // of the speed over the half second before, m/s
  double heading_change = 0.0;  // over the last half second, radians
};
MotionEstimate EstimateMotion(const TargetHistory& history);

// What the networks read about a history, each number about 1:
//
//    0      speed / 10 m/s            5     earlier change of speed, m/s
//    1      lateral speed, m/s        6     change of heading / 0.5 rad
//    2      acceleration / 2 m/s^2    7     length / 5 m
//    3      turn rate * 3 s/rad       8     width / 2 m
//    4      change of speed, m/s            (0-8 each clamped to -4 .. 4)
//    9-38   the deviation from constant velocity v at -1.0, -0.8 .. 0 s: x - v t and y in metres,
//           heading * 5, velocity_x - v, velocity_y * 2, each clamped to -5 .. 5
//   39-41   e^(-|v| / 0.5), e^(-|v| / 2), e^(-|v| / 8): a finer scale for low speeds, v in m/s
inline constexpr int kHistoryInputs = 42;
using HistoryInputs = std::array<float, kHistoryInputs>;
HistoryInputs DescribeHistory(const TargetHistory& history, const MotionEstimate& motion);

// Returns the history in a world `scale` times as large; the box is scaled too.
TargetHistory Scaled(const TargetHistory& history, double scale);
// Returns the history mirrored along the heading: left and right swap.
TargetHistory Mirrored(const TargetHistory& history);

// The noise of a worse sensor. Errors of speed and heading are correlated from state to state
// (autoregressive, coefficient 0.7).
struct SensorNoise {
  double speed_stddev = 0.0;    // m/s; smaller in proportion below 1 m/s
  double heading_stddev = 0.0;  // radians
  uint64_t seed = 0;            // the same seed gives the same noise
};
struct NoisyHistory {
  TargetHistory history;  // in a frame turned by heading_error
  double heading_error;   // radians, counter-clockwise: of the present heading
};
NoisyHistory WithNoise(const TargetHistory& history, const SensorNoise& noise);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_TARGET_HISTORY_H_
