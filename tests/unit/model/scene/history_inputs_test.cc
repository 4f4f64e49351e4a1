// The numbers of a target's history against a second implementation: plain loops, written from the
// formulas of target_history.h alone.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "model/scene/target_history.h"

namespace maneuver::scene::history_inputs_test {
namespace {

constexpr double kPi = std::numbers::pi;

struct State {
  double time, x, y, heading, vx, vy;  // time: from the prediction time on, seconds
};

// The states of the last second in the target's frame, oldest first, headings without jumps.
std::vector<State> LastSecond(const v1::Agent& agent, double now, double x, double y,
                              double heading) {
  std::vector<State> states;
  for (const v1::AgentState& seen : agent.states()) {
    if (seen.time() < now - 1.0 - 1e-6 || seen.time() > now + 1e-6) continue;
    const double c = std::cos(heading), s = std::sin(heading);
    const double dx = seen.x() - x, dy = seen.y() - y;
    states.push_back({seen.time() - now, c * dx + s * dy, c * dy - s * dx, seen.heading() - heading,
                      c * seen.velocity_x() + s * seen.velocity_y(),
                      c * seen.velocity_y() - s * seen.velocity_x()});
  }
  double near = 0.0;
  for (size_t i = states.size(); i-- > 0;) {
    while (states[i].heading > near + kPi) states[i].heading -= 2.0 * kPi;
    while (states[i].heading < near - kPi) states[i].heading += 2.0 * kPi;
    near = states[i].heading;
  }
  return states;
}

State At(const std::vector<State>& states, double time) {
  const State& oldest = states.front();
  if (time <= oldest.time) {
    const double dt = time - oldest.time;
    return {
        time,     oldest.x + dt * oldest.vx, oldest.y + dt * oldest.vy, oldest.heading, oldest.vx,
        oldest.vy};
  }
  for (size_t i = 1; i < states.size(); ++i) {
    const State &a = states[i - 1], &b = states[i];
    if (time > b.time) continue;
    const double p = (b.time - time) / (b.time - a.time), q = 1.0 - p;
    return {time,
            p * a.x + q * b.x,
            p * a.y + q * b.y,
            p * a.heading + q * b.heading,
            p * a.vx + q * b.vx,
            p * a.vy + q * b.vy};
  }
  return states.back();
}

// Least squares by the normal equations: the slope, and the residuals' variance over 9 degrees of
// freedom.
struct Fit {
  double slope, variance;
};
Fit FitLine(const std::vector<double>& t, const std::vector<double>& v) {
  double n = 0, st = 0, sv = 0, stt = 0, stv = 0;
  for (size_t i = 0; i < t.size(); ++i) {
    n += 1;
    st += t[i];
    sv += v[i];
    stt += t[i] * t[i];
    stv += t[i] * v[i];
  }
  const double slope = (n * stv - st * sv) / (n * stt - st * st);
  const double offset = (sv - slope * st) / n;
  double squares = 0;
  for (size_t i = 0; i < t.size(); ++i) squares += std::pow(v[i] - offset - slope * t[i], 2);
  return {slope, squares / 9.0};
}

double Within(double value, double most) { return std::max(-most, std::min(most, value)); }

std::vector<double> PlainInputs(const v1::Agent& agent, double now, double x, double y,
                                double heading) {
  const std::vector<State> seen = LastSecond(agent, now, x, y, heading);
  std::vector<State> states;  // at -1.0, -0.9 .. 0 s
  std::vector<double> t, speeds, headings;
  for (int i = 0; i <= 10; ++i) {
    states.push_back(At(seen, -1.0 + 0.1 * i));
    t.push_back(-1.0 + 0.1 * i);
    const State& state = states.back();
    speeds.push_back(std::cos(state.heading) * state.vx + std::sin(state.heading) * state.vy);
    headings.push_back(state.heading);
  }
  const Fit speed = FitLine(t, speeds), turn = FitLine(t, headings);
  const double v = states[10].vx;
  std::vector<double> inputs = {
      v / 10.0,
      states[10].vy,
      speed.slope / (1.0 + 30.0 * speed.variance / 1.1) / 2.0,
      turn.slope / (1.0 + 100.0 * turn.variance / (1.1 * 0.12 * 0.12)) * 3.0,
      speeds[10] - speeds[5],
      speeds[5] - speeds[0],
      (headings[10] - headings[5]) / 0.5,
      agent.length() / 5.0,
      agent.width() / 2.0,
  };
  for (double& input : inputs) input = Within(input, 4.0);
  for (const size_t i : {0, 2, 4, 6, 8, 10}) {
    const State& s = states[i];
    for (const double deviation : {s.x - v * s.time, s.y, 5.0 * s.heading, s.vx - v, 2.0 * s.vy}) {
      inputs.push_back(Within(deviation, 5.0));
    }
  }
  for (const double scale : {0.5, 2.0, 8.0}) inputs.push_back(std::exp(-std::abs(v) / scale));
  return inputs;
}

// A track as it was recorded. Its frame is that of the latest state that is not after `now`.
struct Track {
  std::string name;
  double now;
  v1::Agent agent;
};

// A vehicle seen at `times`, seconds from `now` on. Speed and heading are functions of the time;
// positions follow from them.
Track Drive(const std::string& name, double now, const std::vector<double>& times,
            const std::function<double(double)>& speed,
            const std::function<double(double)>& heading, double length = 4.6, double width = 2.0) {
  Track track{name, now, {}};
  track.agent.set_id(1);
  track.agent.set_type(v1::AGENT_TYPE_VEHICLE);
  track.agent.set_length(length);
  track.agent.set_width(width);
  double x = 130.0, y = -42.0, at = times.front();
  for (const double time : times) {
    constexpr int kSteps = 50;
    for (int j = 0; j < kSteps; ++j) {
      const double s = at + (time - at) * (j + 0.5) / kSteps;
      x += (time - at) / kSteps * speed(s) * std::cos(heading(s));
      y += (time - at) / kSteps * speed(s) * std::sin(heading(s));
    }
    at = time;
    v1::AgentState& state = *track.agent.add_states();
    state.set_time(now + time);
    state.set_x(x);
    state.set_y(y);
    state.set_heading(static_cast<float>(std::remainder(heading(time), 2.0 * kPi)));
    state.set_velocity_x(static_cast<float>(speed(time) * std::cos(heading(time))));
    state.set_velocity_y(static_cast<float>(speed(time) * std::sin(heading(time))));
  }
  return track;
}

// Times from `first` on to `last` in steps of `interval`.
std::vector<double> Every(double interval, double first, double last) {
  std::vector<double> times;
  for (int i = static_cast<int>(std::lround(first / interval)); i * interval < last + 1e-9; ++i) {
    times.push_back(i * interval);
  }
  return times;
}

// The same track with errors in everything that was measured.
Track Noisy(Track track, double metres, double radians, uint32_t seed) {
  track.name += " with noise " + std::to_string(seed);
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  for (v1::AgentState& state : *track.agent.mutable_states()) {
    state.set_x(state.x() + metres * normal(random));
    state.set_y(state.y() + metres * normal(random));
    state.set_heading(
        static_cast<float>(std::remainder(state.heading() + radians * normal(random), 2.0 * kPi)));
    state.set_velocity_x(static_cast<float>(state.velocity_x() + metres * normal(random)));
    state.set_velocity_y(static_cast<float>(state.velocity_y() + metres * normal(random)));
  }
  return track;
}

std::vector<Track> Tracks() {
  const std::vector<double> all = Every(0.1, -1.5, 1.5);
  const auto steady = [](double value) { return [value](double) { return value; }; };
  const auto speeding = [](double t) { return 9.0 + 2.5 * t; };
  const auto braking = [](double t) { return 11.0 - 3.0 * t - 1.5 * t * t; };
  const auto winding = [](double t) { return 1.0 + 0.4 * t + 0.3 * std::sin(5.0 * t); };
  const auto across_pi = [](double t) { return 3.1 + 0.7 * t; };  // over +pi before now
  const auto back_over_pi = [](double t) { return -3.1 - 0.5 * t * t + 0.1 * t; };
  std::vector<Track> tracks = {
      Drive("straight", 12.0, all, steady(8.0), steady(0.3)),
      Drive("accelerating", 12.0, all, speeding, steady(-2.0)),
      Drive("braking", 0.0, all, braking, steady(2.0)),
      Drive("turning", 3.0, all, steady(7.0), [](double t) { return 0.5 - 0.35 * t; }),
      Drive("winding", 3.0, all, speeding, winding),
      Drive("turning over pi", 3.0, all, braking, across_pi),
      Drive("turning back over pi", 3.0, all, braking, back_over_pi),
      Drive("standing", 5.0, all, steady(0.0), steady(1.2)),
      Drive("standing and turning", 5.0, all, steady(0.0), [](double t) { return 0.2 * t; }),
      Drive(
          "starting", 5.0, all, [](double t) { return std::max(0.0, 1.0 + 1.7 * t); }, winding),
      Drive(
          "backing", 5.0, all, [](double t) { return -1.5 - 0.5 * t; }, winding),
      Drive("a fast lorry", 5.0, all, steady(62.0), steady(0.0), 24.0, 2.6),
      Drive("skidding round", 5.0, all, braking, [](double t) { return 3.5 * t; }),
      // Other rates than 10 Hz, and a prediction time between two states' times at 10 Hz.
      Drive("at 25 Hz", 7.0, Every(0.04, -1.6, 0.4), speeding, winding),
      Drive("at 4 Hz", 7.0, Every(0.25, -1.5, 0.5), speeding, winding),
      Drive("at 7 Hz", 7.0, Every(1.0 / 7.0, -1.3, 0.3), speeding, winding),
      Drive("at 2 Hz", 7.0, Every(0.5, -1.5, 0.5), speeding, winding),
      Drive("irregular", 7.0, {-1.05, -0.93, -0.81, -0.8, -0.42, -0.37, -0.11, 0.0, 0.08}, speeding,
            winding),
      // Gaps.
      Drive("gap", 7.0, {-1.2, -1.0, -0.9, -0.3, -0.2, -0.1, 0.0, 0.1}, speeding, winding),
      Drive("gap before now", 7.0, {-1.0, -0.9, -0.8, -0.7, 0.0}, braking, winding),
      Drive("gap over the oldest", 7.0, {-1.6, -1.3, -0.6, -0.5, -0.2, 0.0}, braking, winding),
      Drive("gap across pi", 7.0, {-1.0, -0.5, 0.0}, speeding,
            [](double t) { return 3.0 + 2.0 * t; }),
      // Short tracks.
      Drive("three states", 7.0, {-0.2, -0.1, 0.0}, speeding, winding),
      Drive("two states", 7.0, {-0.1, 0.0, 0.1}, speeding, winding),
      Drive("one state", 7.0, {0.0}, steady(6.0), steady(1.0)),
      Drive("one state before the future", 7.0, {0.0, 0.1, 0.2}, speeding, winding),
      // Clocks are sums of intervals.
      Drive("a clock with rounding errors", 7.0, {-1.0 - 4e-7, -0.5, 5e-7, 0.1}, speeding, winding),
      Drive("a state that is just too old", 7.0, {-1.0 - 4e-6, -0.5, 0.0, 3e-6}, braking, winding),
  };
  const size_t exact = tracks.size();
  for (size_t i = 0; i < exact; ++i) {
    tracks.push_back(Noisy(tracks[i], 0.05, 0.01, static_cast<uint32_t>(3 * i + 1)));
    tracks.push_back(Noisy(tracks[i], 0.6, 0.15, static_cast<uint32_t>(3 * i + 2)));
  }
  return tracks;
}

TEST(HistoryInputsTest, AreThoseOfTheFormulas) {
  std::vector<double> least(kHistoryInputs, HUGE_VAL), most(kHistoryInputs, -HUGE_VAL);
  for (const Track& track : Tracks()) {
    const v1::AgentState* present = nullptr;
    for (const v1::AgentState& state : track.agent.states()) {
      if (state.time() <= track.now + 1e-6) present = &state;
    }
    ASSERT_NE(present, nullptr);
    const std::vector<double> expected =
        PlainInputs(track.agent, track.now, present->x(), present->y(), present->heading());
    const TargetHistory history = ResampleHistory(
        track.agent, track.now, Pose2(present->x(), present->y(), present->heading()));
    const HistoryInputs inputs = DescribeHistory(history, EstimateMotion(history));
    ASSERT_EQ(expected.size(), inputs.size());
    for (size_t i = 0; i < inputs.size(); ++i) {
      EXPECT_NEAR(inputs[i], expected[i], 2e-6) << track.name << ", number " << i;
      least[i] = std::min(least[i], expected[i]);
      most[i] = std::max(most[i], expected[i]);
    }
  }
  // Each number was at work. The last state's x, y, heading and velocity - v are 0 by definition, but
  // for the clock's errors.
  for (size_t i = 0; i < least.size(); ++i) {
    if (i >= 34 && i <= 37) {
      EXPECT_NEAR(std::max(-least[i], most[i]), 0.0, 1e-5) << i;
    } else {
      EXPECT_GT(most[i] - least[i], 0.2) << i;
    }
  }
}

}  // namespace
}  // namespace maneuver::scene::history_inputs_test
