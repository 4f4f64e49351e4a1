// Measures what two keyframes a second leave of a track, on real recordings at ten frames a second:
// MANEUVER_REAL_DATA names the folder of the unpacked Waymo archive, or its parent.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <vector>

#include "model/data/nuscenes/keyframes.h"
#include "model/scene/target_motion.h"
#include "tests/unit/model/data/moving_vehicles.h"

namespace maneuver::data::real_keyframes_test {
namespace {

constexpr int kEvery = 5;  // frames from keyframe to keyframe
constexpr double kHorizon = 3.0;

double ConstantVelocityError(const v1::AgentState& now, const v1::AgentState& then) {
  return std::hypot(now.x() + kHorizon * now.velocity_x() - then.x(),
                    now.y() + kHorizon * now.velocity_y() - then.y());
}

TEST(RealKeyframesTest, ThePresentMotionSurvivesTwoKeyframesASecond) {
  const char* folder = std::getenv("MANEUVER_REAL_DATA");
  if (folder == nullptr || *folder == '\0') {
    GTEST_SKIP() << "MANEUVER_REAL_DATA is not set: no real recordings to read";
  }
  int64_t vehicles = 0;
  Errors position, velocity, heading, interpolated, original;
  std::array<Errors, scene::kMotionInputs> inputs;
  ForEachMovingVehicle(folder, [&](const v1::Agent& agent) {
    ++vehicles;
    // On a clock of even frames: the recordings' own jitters by milliseconds.
    v1::Agent even = agent;
    std::vector<Keyframe> keyframes;
    for (int i = 0; i < even.states_size(); ++i) {
      v1::AgentState* const state = even.mutable_states(i);
      state->set_time(kFrameInterval * i);
      if (i % kEvery == 0) {
        keyframes.push_back({state->time(), state->x(), state->y(), state->heading()});
      }
    }
    v1::Agent filled;
    AddFrames(keyframes, &filled);
    ASSERT_EQ(filled.states_size(), even.states_size());
    for (int i = 0; i < even.states_size(); ++i) {
      const v1::AgentState& truth = even.states(i);
      const v1::AgentState& state = filled.states(i);
      position.Add(std::hypot(state.x() - truth.x(), state.y() - truth.y()));
      velocity.Add(std::hypot(state.velocity_x() - truth.velocity_x(),
                              state.velocity_y() - truth.velocity_y()));
      heading.Add(std::remainder(state.heading() - truth.heading(), 2.0 * M_PI));
      if (i >= 10) {
        const auto expected = scene::DescribeMotion(even, truth.time());
        const auto found = scene::DescribeMotion(filled, truth.time());
        for (size_t k = 0; k < inputs.size(); ++k) inputs[k].Add(found[k] - expected[k]);
      }
      if (i + 30 >= even.states_size()) continue;
      interpolated.Add(ConstantVelocityError(state, even.states(i + 30)));
      original.Add(ConstantVelocityError(truth, even.states(i + 30)));
    }
  });
  ASSERT_GT(vehicles, 50);
  std::cout << vehicles << " vehicles; root mean squares: position " << position.RootMeanSquare()
            << " m, velocity " << velocity.RootMeanSquare() << " m/s, heading "
            << heading.RootMeanSquare() << " rad; motion inputs";
  for (const Errors& input : inputs) std::cout << " " << input.RootMeanSquare();
  std::cout << "; constant velocity at 3 s " << interpolated.RootMeanSquare() << " m, of the "
            << "original " << original.RootMeanSquare() << " m\n";
  EXPECT_LT(position.RootMeanSquare(), 0.1);
  EXPECT_LT(velocity.RootMeanSquare(), 0.5);
  EXPECT_LT(heading.RootMeanSquare(), 0.02);
  // Filled frames must not know much more about the future than real ones.
  EXPECT_GT(interpolated.RootMeanSquare(), 0.97 * original.RootMeanSquare());
  EXPECT_LT(interpolated.RootMeanSquare(), 1.1 * original.RootMeanSquare());
}

}  // namespace
}  // namespace maneuver::data::real_keyframes_test
