// Measures velocities that are fitted to positions, on real recordings that state both:
// MANEUVER_REAL_DATA names the folder of the unpacked Waymo archive, or its parent.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <iostream>
#include <random>
#include <tuple>
#include <vector>

#include "model/data/argoverse/motion_fit.h"
#include "tests/unit/model/data/moving_vehicles.h"

namespace maneuver::data::real_motion_fit_test {
namespace {

struct Fitted {
  Errors velocity;
  Errors heading;  // where the fit says 1 m/s or more
};

Fitted Measure(const char* folder, double sigma) {
  Fitted fitted;
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0.0, 1.0);
  ForEachMovingVehicle(folder, [&](const v1::Agent& agent) {
    std::vector<double> times;
    std::vector<scene::Point2> positions;
    for (const v1::AgentState& state : agent.states()) {
      times.push_back(state.time());
      positions.push_back({state.x() + sigma * noise(random), state.y() + sigma * noise(random)});
    }
    const std::vector<scene::Point2> velocities = FitVelocities(times, positions);
    for (int i = 10; i < agent.states_size(); ++i) {
      const v1::AgentState& truth = agent.states(i);
      const scene::Point2& velocity = velocities[static_cast<size_t>(i)];
      fitted.velocity.Add(
          std::hypot(velocity.x - truth.velocity_x(), velocity.y - truth.velocity_y()));
      if (std::hypot(velocity.x, velocity.y) < 1.0) continue;
      fitted.heading.Add(
          std::remainder(std::atan2(velocity.y, velocity.x) - truth.heading(), 2.0 * M_PI));
    }
  });
  return fitted;
}

TEST(RealMotionFitTest, PositionsAloneGiveTheMotion) {
  const char* folder = std::getenv("MANEUVER_REAL_DATA");
  if (folder == nullptr || *folder == '\0') {
    GTEST_SKIP() << "MANEUVER_REAL_DATA is not set: no real recordings to read";
  }
  for (const auto& [sigma, velocity, heading] :
       {std::tuple(0.0, 0.4, 0.1), std::tuple(0.1, 0.6, 0.15)}) {
    const Fitted fitted = Measure(folder, sigma);
    ASSERT_GT(fitted.velocity.count, 1000);
    std::cout << "noise of positions " << sigma << " m: root mean squares of velocity "
              << fitted.velocity.RootMeanSquare() << " m/s, heading "
              << fitted.heading.RootMeanSquare() << " rad\n";
    EXPECT_LT(fitted.velocity.RootMeanSquare(), velocity);
    EXPECT_LT(fitted.heading.RootMeanSquare(), heading);
  }
}

}  // namespace
}  // namespace maneuver::data::real_motion_fit_test
