#include "model/scene/target_history.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "model/scene/target_frame.h"

namespace maneuver::scene {
namespace {

constexpr double kCorrelation = 0.7;  // of a sensor's noise from state to state
constexpr double kAccelerationShrinkage = 30.0;
constexpr double kTurnShrinkage = 100.0;
constexpr double kTypicalTurnNoise = 0.12;  // rad
constexpr double kLargestMotion = 4.0;
constexpr double kLargestDeparture = 5.0;

double TimeOf(int state) { return (state - (kHistoryStates - 1)) * kHistoryInterval; }

double SpeedAlongBody(const PastState& state) {
  return state.velocity_x * std::cos(state.heading) + state.velocity_y * std::sin(state.heading);
}

// Returns `state` in the frame X_WT, its heading within pi of `near`.
PastState InFrame(const v1::AgentState& state, const Pose2& X_WT, double near) {
  const Point2 position = X_WT.ToLocal({state.x(), state.y()});
  const Point2 velocity =
      Pose2(0.0, 0.0, X_WT.heading()).ToLocal({state.velocity_x(), state.velocity_y()});
  const double heading = state.heading() - X_WT.heading();
  return {position.x, position.y, near + std::remainder(heading - near, 2.0 * std::numbers::pi),
          velocity.x, velocity.y};
}

PastState Between(const PastState& a, const PastState& b, double share) {
  const auto mix = [share](double from, double to) { return from + share * (to - from); };
  return {mix(a.x, b.x), mix(a.y, b.y), mix(a.heading, b.heading), mix(a.velocity_x, b.velocity_x),
          mix(a.velocity_y, b.velocity_y)};
}

PastState Moved(const PastState& state, double seconds) {
  PastState moved = state;
  moved.x += seconds * state.velocity_x;
  moved.y += seconds * state.velocity_y;
  return moved;
}

struct Line {
  double slope;              // per second
  double residual_variance;  // over 9 degrees of freedom
};

constexpr double kSquaredTimes = 1.1;  // sum over the states of (t - mean t)^2, s^2

Line FitLine(const std::array<double, kHistoryStates>& values) {
  double mean = 0.0;
  for (const double value : values) mean += value / kHistoryStates;
  const double mean_time = 0.5 * TimeOf(0);
  double slope = 0.0;
  for (int i = 0; i < kHistoryStates; ++i) {
    slope += (TimeOf(i) - mean_time) * (values[static_cast<size_t>(i)] - mean) / kSquaredTimes;
  }
  double squares = 0.0;
  for (int i = 0; i < kHistoryStates; ++i) {
    const double residual = values[static_cast<size_t>(i)] - mean - slope * (TimeOf(i) - mean_time);
    squares += residual * residual;
  }
  return {slope, squares / (kHistoryStates - 2)};
}

float Held(double value, double largest) {
  return static_cast<float>(std::clamp(value, -largest, largest));
}

// Rotates a vector into a frame that is turned by `angle`.
void Turn(double angle, double* x, double* y) {
  const double c = std::cos(angle), s = std::sin(angle);
  const double turned = *x * c + *y * s;
  *y = *y * c - *x * s;
  *x = turned;
}

}  // namespace

TargetHistory ResampleHistory(const v1::Agent& agent, double time, const Pose2& X_WT,
                              double oldest) {
  TargetHistory history;
  history.length = agent.length();
  history.width = agent.width();
  int index = FindState(agent, time, HUGE_VAL, time + kSameTime);
  if (index < 0) return history;
  const auto counts = [&](int i) {
    return i >= 0 && agent.states(i).time() >= time - oldest - kSameTime;
  };
  PastState later = InFrame(agent.states(index), X_WT, 0.0);
  double later_time = agent.states(index).time() - time;
  PastState earlier = later;
  double earlier_time = later_time;
  for (int i = kHistoryStates - 1; i >= 0; --i) {
    const double wanted = TimeOf(i);
    while (earlier_time > wanted && counts(index - 1)) {
      later = earlier;
      later_time = earlier_time;
      earlier = InFrame(agent.states(--index), X_WT, later.heading);
      earlier_time = agent.states(index).time() - time;
    }
    PastState& state = history.states[static_cast<size_t>(i)];
    if (wanted <= earlier_time) {
      state = Moved(earlier, wanted - earlier_time);
    } else if (wanted >= later_time) {
      state = Moved(later, wanted - later_time);
    } else {
      state = Between(earlier, later, (wanted - earlier_time) / (later_time - earlier_time));
    }
  }
  return history;
}

MotionEstimate EstimateMotion(const TargetHistory& history) {
  std::array<double, kHistoryStates> speeds;
  std::array<double, kHistoryStates> headings;
  for (size_t i = 0; i < kHistoryStates; ++i) {
    speeds[i] = SpeedAlongBody(history.states[i]);
    headings[i] = history.states[i].heading;
  }
  const Line speed = FitLine(speeds);
  const Line heading = FitLine(headings);
  constexpr size_t kNow = kHistoryStates - 1, kHalf = kNow / 2;
  return {
      .speed = history.states[kNow].velocity_x,
      .lateral_speed = history.states[kNow].velocity_y,
      .acceleration =
          speed.slope / (1.0 + kAccelerationShrinkage * speed.residual_variance / kSquaredTimes),
      .turn_rate =
          heading.slope / (1.0 + kTurnShrinkage * heading.residual_variance /
                                     (kSquaredTimes * kTypicalTurnNoise * kTypicalTurnNoise)),
      .speed_change = speeds[kNow] - speeds[kHalf],
      .earlier_change = speeds[kHalf] - speeds[0],
      .heading_change = headings[kNow] - headings[kHalf],
  };
}

HistoryInputs DescribeHistory(const TargetHistory& history, const MotionEstimate& motion) {
  HistoryInputs inputs;
  size_t next = 0;
  for (const double value :
       {motion.speed / 10.0, motion.lateral_speed, motion.acceleration / 2.0,
        motion.turn_rate * 3.0, motion.speed_change, motion.earlier_change,
        motion.heading_change / 0.5, history.length / 5.0, history.width / 2.0}) {
    inputs[next++] = Held(value, kLargestMotion);
  }
  for (int i = 0; i < kHistoryStates; i += 2) {
    const PastState& state = history.states[static_cast<size_t>(i)];
    for (const double value : {state.x - motion.speed * TimeOf(i), state.y, state.heading * 5.0,
                               state.velocity_x - motion.speed, state.velocity_y * 2.0}) {
      inputs[next++] = Held(value, kLargestDeparture);
    }
  }
  for (const double slow : {0.5, 2.0, 8.0}) {
    inputs[next++] = static_cast<float>(std::exp(-std::abs(motion.speed) / slow));
  }
  return inputs;
}

TargetHistory Scaled(const TargetHistory& history, double scale) {
  TargetHistory scaled = history;
  scaled.length *= scale;
  scaled.width *= scale;
  for (PastState& state : scaled.states) {
    state.x *= scale;
    state.y *= scale;
    state.velocity_x *= scale;
    state.velocity_y *= scale;
  }
  return scaled;
}

TargetHistory Mirrored(const TargetHistory& history) {
  TargetHistory mirrored = history;
  for (PastState& state : mirrored.states) {
    state.y = -state.y;
    state.heading = -state.heading;
    state.velocity_y = -state.velocity_y;
  }
  return mirrored;
}

NoisyHistory WithNoise(const TargetHistory& history, const SensorNoise& noise) {
  std::mt19937_64 generator(noise.seed);
  const auto draw = [&generator](double stddev) {
    std::array<double, kHistoryStates> values;
    std::normal_distribution<double> normal(0.0, stddev > 0.0 ? stddev : 1.0);
    const double fresh = std::sqrt(1.0 - kCorrelation * kCorrelation);
    for (size_t i = 0; i < kHistoryStates; ++i) {
      const double innovation = stddev > 0.0 ? normal(generator) : 0.0;
      values[i] = i == 0 ? innovation : kCorrelation * values[i - 1] + fresh * innovation;
    }
    return values;
  };
  const auto speeds = draw(noise.speed_stddev);
  const auto headings = draw(noise.heading_stddev);
  NoisyHistory noisy{history, headings.back()};
  // Noise must not make a standing vehicle move.
  const double moving = std::min(1.0, std::abs(history.states.back().velocity_x));
  for (size_t i = 0; i < kHistoryStates; ++i) {
    PastState& state = noisy.history.states[i];
    state.velocity_x += moving * speeds[i];
    Turn(noisy.heading_error, &state.x, &state.y);
    Turn(noisy.heading_error, &state.velocity_x, &state.velocity_y);
    state.heading += headings[i] - noisy.heading_error;
  }
  return noisy;
}

}  // namespace maneuver::scene
