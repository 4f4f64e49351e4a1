#include "model/data/town/sensor_model.h"

#include <cmath>

#include "gtest/gtest.h"

namespace maneuver::data::town::sensor_model_test {
namespace {

// Returns a track straight through the middle at 10 m/s, for twenty seconds.
Track Through() {
  Track track;
  track.id = 3;
  for (int i = 0; i <= 200; ++i) {
    track.points.push_back(
        {.time = 0.1 * i, .p = {-100.0 + i, 5.0}, .velocity = {10.0, 0.0}, .speed = 10.0});
  }
  return track;
}

TEST(SensorModelTest, ReportsOnlyWhatIsWithinTheRadius) {
  SensorModel sensor;
  sensor.radius = 60.0;
  sensor.gap_chance = 0.0;
  Random random(1, 1, 1);
  const auto sighting = Observe(sensor, Through(), 0.1, random);
  ASSERT_TRUE(sighting.has_value());
  // |x| < sqrt(60^2 - 5^2) = 59.79.
  EXPECT_NEAR(sighting->first, 4.1, 1e-9);
  EXPECT_NEAR(sighting->last, 15.9, 1e-9);
  EXPECT_EQ(sighting->reported.size(), 119u);
}

TEST(SensorModelTest, ErrorsHaveTheStatedSizeAndPersist) {
  SensorModel sensor;
  sensor.radius = 1000.0;
  sensor.gap_chance = 0.0;
  Random random(1, 2, 1);
  const Track truth = Through();
  double square = 0.0;
  double product = 0.0;
  int count = 0;
  for (int repeat = 0; repeat < 200; ++repeat) {
    const auto sighting = Observe(sensor, truth, 0.1, random);
    double before = 0.0;
    for (size_t i = 0; i < sighting->reported.size(); ++i) {
      const double error = sighting->reported[i].p.y - 5.0;
      square += error * error;
      if (i > 0) product += error * before;
      before = error;
      ++count;
    }
  }
  EXPECT_NEAR(std::sqrt(square / count), sensor.position_noise, 0.1 * sensor.position_noise);
  EXPECT_NEAR(product / square, std::exp(-0.1 / sensor.correlation_time), 0.03);
}

TEST(SensorModelTest, ATrackHasAtMostOneShortGap) {
  SensorModel sensor;
  sensor.radius = 1000.0;
  sensor.gap_chance = 1.0;
  Random random(1, 3, 1);
  int total = 0;
  for (int repeat = 0; repeat < 50; ++repeat) {
    const auto sighting = Observe(sensor, Through(), 0.1, random);
    int gaps = 0;
    for (size_t i = 1; i < sighting->reported.size(); ++i) {
      const double step = sighting->reported[i].time - sighting->reported[i - 1].time;
      if (step > 0.15) ++gaps;
      EXPECT_LE(step, sensor.longest_gap + 0.1 + 1e-9);
    }
    EXPECT_LE(gaps, 1);
    total += gaps;
  }
  EXPECT_GT(total, 0);
}

TEST(SensorModelTest, DropsTracksThatAreTooShort) {
  SensorModel sensor;
  sensor.radius = 8.0;  // seen for 1.2 s
  sensor.shortest_track = 2.0;
  Random random(1, 4, 1);
  EXPECT_FALSE(Observe(sensor, Through(), 0.1, random).has_value());
}

}  // namespace
}  // namespace maneuver::data::town::sensor_model_test
