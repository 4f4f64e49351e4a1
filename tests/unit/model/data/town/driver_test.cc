#include "model/data/town/driver.h"

#include <cmath>
#include <limits>

#include "gtest/gtest.h"

namespace maneuver::data::town::driver_test {
namespace {

constexpr double kNobody = std::numeric_limits<double>::infinity();

TEST(DriverTest, AcceleratesTowardsTheDesiredSpeedOnAFreeRoad) {
  const Driver driver;
  EXPECT_GT(IdmAcceleration(driver, 5.0, 14.0, kNobody, 0.0), 1.0);
  EXPECT_NEAR(IdmAcceleration(driver, 14.0, 14.0, kNobody, 0.0), 0.0, 1e-12);
  EXPECT_LT(IdmAcceleration(driver, 17.0, 14.0, kNobody, 0.0), 0.0);
}

TEST(DriverTest, KeepsTheEquilibriumGapOfTheModel) {
  // At equal speeds, the model is in equilibrium at (s0 + v T) / sqrt(1 - (v / v0)^4).
  const Driver driver;
  const double v = 10.0;
  const double gap =
      (driver.standstill_gap + v * driver.headway) / std::sqrt(1.0 - std::pow(v / 14.0, 4.0));
  EXPECT_NEAR(IdmAcceleration(driver, v, 14.0, gap, v), 0.0, 1e-9);
  EXPECT_LT(IdmAcceleration(driver, v, 14.0, 0.9 * gap, v), 0.0);
  EXPECT_GT(IdmAcceleration(driver, v, 14.0, 1.1 * gap, v), 0.0);
}

TEST(DriverTest, FollowerStopsBehindAStandingLeaderWithoutTouchingIt) {
  const Driver driver;
  double gap = 120.0;
  double speed = 14.0;
  for (int i = 0; i < 6000; ++i) {
    speed = std::max(0.0, speed + 0.01 * IdmAcceleration(driver, speed, 14.0, gap, 0.0));
    gap -= 0.01 * speed;
  }
  EXPECT_LT(speed, 0.05);
  EXPECT_NEAR(gap, driver.standstill_gap, 0.5);
}

TEST(DriverTest, DrawsDifferentDrivers) {
  Random random(1, 2, 3);
  const Driver a = DrawDriver(random);
  const Driver b = DrawDriver(random);
  EXPECT_NE(a.speed_factor, b.speed_factor);
  EXPECT_NE(a.acceleration, b.acceleration);
  EXPECT_NE(a.headway, b.headway);
  EXPECT_NE(a.offset, b.offset);
  EXPECT_NE(a.corner_cut, b.corner_cut);
}

}  // namespace
}  // namespace maneuver::data::town::driver_test
