#include "model/data/town/driver.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace maneuver::data::town {

Driver DrawDriver(Random& random) {
  Driver driver;
  driver.speed_factor = random.ClampedNormal(0.97, 0.1, 0.75, 1.2);
  driver.acceleration = random.ClampedNormal(1.8, 0.35, 1.1, 2.8);
  driver.braking = random.ClampedNormal(2.0, 0.3, 1.4, 2.8);
  driver.headway = random.ClampedNormal(1.3, 0.3, 0.8, 2.1);
  driver.standstill_gap = random.ClampedNormal(2.2, 0.5, 1.4, 3.5);
  driver.lateral_comfort = random.ClampedNormal(2.5, 0.4, 1.6, 3.5);
  driver.patience = random.ClampedNormal(4.2, 0.6, 3.2, 6.0);
  driver.offset = random.ClampedNormal(0.0, 0.12, -0.28, 0.28);
  driver.corner_cut = random.ClampedNormal(0.1, 0.3, -0.5, 0.6);
  driver.wander = random.Uniform(0.03, 0.16);
  driver.wander_length = random.Uniform(80.0, 200.0);
  driver.wander_phase = random.Uniform(0.0, 2.0 * std::numbers::pi);
  driver.change_time = random.ClampedNormal(4.2, 0.7, 3.0, 6.0);
  return driver;
}

Driver DrawCyclist(Random& random) {
  Driver driver = DrawDriver(random);
  driver.acceleration = random.Uniform(0.7, 1.2);
  driver.standstill_gap = 0.8;
  driver.lateral_comfort = 1.8;
  driver.offset = random.Uniform(-0.2, 0.2);
  driver.corner_cut = 0.0;
  driver.wander = random.Uniform(0.05, 0.2);
  driver.wander_length = random.Uniform(25.0, 60.0);
  return driver;
}

double IdmAcceleration(const Driver& driver, double speed, double desired_speed, double gap,
                       double leader_speed) {
  double wish = 0.0;
  if (speed <= desired_speed) {
    wish = driver.acceleration * (1.0 - std::pow(speed / desired_speed, 4.0));
  } else {
    wish = -driver.braking * (1.0 - std::pow(desired_speed / speed, 2.0));
  }
  if (!std::isfinite(gap)) return wish;
  const double closing =
      speed * (speed - leader_speed) / (2.0 * std::sqrt(driver.acceleration * driver.braking));
  const double wanted = driver.standstill_gap + std::max(0.0, speed * driver.headway + closing);
  const double ratio = wanted / std::max(0.1, gap);
  return wish - driver.acceleration * ratio * ratio;
}

}  // namespace maneuver::data::town
