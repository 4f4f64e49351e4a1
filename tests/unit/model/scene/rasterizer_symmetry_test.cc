// How moving, turning and mirroring the world affects the picture.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <random>

#include "model/scene/rasterizer.h"
#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::rasterizer_symmetry_test {
namespace {

constexpr int64_t kTarget = 1;
constexpr double kNow = 1.0;

// Headings are floats: turning the world rounds them by 1e-7, and points of 1e4 m by 1e-12.
constexpr double kMeanTolerance = 0.001;  // levels
constexpr int kLargestTolerance = 1;      // levels
// Lines are simplified by up to 0.05 pixels, and differently if the picture's edge is elsewhere.
constexpr int kSimplificationTolerance = 14;  // levels
// Different pictures differ by at least this much, so that the test can distinguish them.
constexpr double kMeanOfOtherPicture = 1.0;

v1::RasterSpec Spec(int height) {
  v1::RasterSpec spec;
  spec.set_height(height);
  spec.set_width(80);
  spec.set_meters_per_pixel(0.7);
  spec.set_target_position(0.3);
  spec.set_history_frames(4);
  spec.mutable_frame_interval()->set_nanos(100'000'000);
  return spec;
}

// A crowded, asymmetric scene.
v1::Scenario CrowdedScene(std::mt19937_64* random) {
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(*random);
  };
  v1::Scenario scenario;
  for (int id = 1; id <= 12; ++id) {
    const auto type = static_cast<v1::AgentType>(id % 5);
    v1::Agent* agent = AddAgent(&scenario, id, type, uniform(0.5, 8), uniform(0.5, 3));
    const double heading = uniform(-3, 3);
    const double x = uniform(-15, 35);
    const double y = uniform(-20, 20);
    const double speed = uniform(0, 15);
    for (int i = 0; i <= 12; ++i) {
      const double t = 0.1 * i;
      AddState(agent, t, x + speed * t * std::cos(heading), y + speed * t * std::sin(heading),
               heading + 0.3 * t);
    }
  }
  for (int i = 0; i < 27; ++i) {
    const auto type = static_cast<v1::MapFeatureType>(1 + i % 9);
    const bool area = type == v1::MAP_FEATURE_TYPE_CROSSWALK ||
                      type == v1::MAP_FEATURE_TYPE_SPEED_BUMP ||
                      type == v1::MAP_FEATURE_TYPE_DRIVEWAY;
    v1::MapFeature* feature = AddFeature(&scenario, type, {});
    feature->set_id(i + 1);
    double x = uniform(-25, 45);
    double y = uniform(-30, 30);
    double heading = uniform(-3, 3);
    const int points = area ? 5 : type == v1::MAP_FEATURE_TYPE_STOP_SIGN ? 1 : 60;
    for (int k = 0; k < points; ++k) {
      feature->add_x(x);
      feature->add_y(y);
      heading += area ? 2 * M_PI / points : uniform(-0.1, 0.12);
      const double step = area ? 5.0 : 0.8;
      x += step * std::cos(heading);
      y += step * std::sin(heading);
    }
  }
  v1::TrafficSignal* signal = scenario.add_traffic_signals();
  signal->set_lane_id(1);
  signal->add_readings()->set_state(v1::TRAFFIC_SIGNAL_STATE_STOP);
  return scenario;
}

Pose2 TargetOf(const v1::Scenario& scenario) {
  const v1::AgentState& state = scenario.agents(0).states(10);
  return Pose2(state.x(), state.y(), state.heading());
}

v1::Scenario Moved(const Pose2& X_VW, v1::Scenario scenario) {
  for (v1::Agent& agent : *scenario.mutable_agents()) {
    for (v1::AgentState& state : *agent.mutable_states()) {
      const Point2 p = X_VW * Point2{state.x(), state.y()};
      state.set_x(p.x);
      state.set_y(p.y);
      state.set_heading(static_cast<float>(state.heading() + X_VW.heading()));
    }
  }
  for (v1::MapFeature& feature : *scenario.mutable_map_features()) {
    for (int i = 0; i < feature.x_size(); ++i) {
      const Point2 p = X_VW * Point2{feature.x(i), feature.y(i)};
      feature.set_x(i, p.x);
      feature.set_y(i, p.y);
    }
  }
  return scenario;
}

v1::Scenario Mirrored(v1::Scenario scenario) {
  for (v1::Agent& agent : *scenario.mutable_agents()) {
    for (v1::AgentState& state : *agent.mutable_states()) {
      state.set_y(-state.y());
      state.set_heading(-state.heading());
    }
  }
  for (v1::MapFeature& feature : *scenario.mutable_map_features()) {
    for (double& y : *feature.mutable_y()) y = -y;
  }
  return scenario;
}

double MeanDifference(const Picture& a, const Picture& b) {
  double sum = 0.0;
  for (size_t i = 0; i < a.bytes().size(); ++i) sum += std::abs(a.bytes()[i] - b.bytes()[i]);
  return sum / static_cast<double>(a.bytes().size());
}

int LargestDifference(const Picture& a, const Picture& b) {
  int largest = 0;
  for (size_t i = 0; i < a.bytes().size(); ++i) {
    largest = std::max(largest, std::abs(a.bytes()[i] - b.bytes()[i]));
  }
  return largest;
}

TEST(RasterSymmetryTest, MovingTheWholeWorldLeavesThePictureUnchanged) {
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> place(-1e4, 1e4);
  std::uniform_real_distribution<double> angle(-M_PI, M_PI);
  const v1::RasterSpec spec = Spec(64);
  for (int trial = 0; trial < 20; ++trial) {
    const v1::Scenario scenario = CrowdedScene(&random);
    const Picture raster = Draw(spec, scenario, kNow, kTarget, TargetOf(scenario));
    const Pose2 X_VW(place(random), place(random), angle(random));
    const v1::Scenario moved = Moved(X_VW, scenario);
    const Picture again = Draw(spec, moved, kNow, kTarget, TargetOf(moved));
    EXPECT_LT(MeanDifference(raster, again), kMeanTolerance) << "trial " << trial;
    EXPECT_LE(LargestDifference(raster, again), kLargestTolerance) << "trial " << trial;
  }
}

TEST(RasterSymmetryTest, TurningTheWorldButNotTheTargetChangesThePicture) {
  std::mt19937_64 random(12);
  const v1::RasterSpec spec = Spec(64);
  const v1::Scenario scenario = CrowdedScene(&random);
  const Pose2 X_WT = TargetOf(scenario);
  const Picture raster = Draw(spec, scenario, kNow, kTarget, X_WT);
  const Picture turned =
      Draw(spec, scenario, kNow, kTarget, Pose2(X_WT.x(), X_WT.y(), X_WT.heading() + 0.2));
  EXPECT_GT(MeanDifference(raster, turned), kMeanOfOtherPicture);
}

TEST(RasterSymmetryTest, MirroredRasterIsTheRasterOfTheMirroredWorld) {
  std::mt19937_64 random(13);
  for (const int height : {64, 65}) {
    const v1::RasterSpec spec = Spec(height);
    const v1::Scenario scenario = CrowdedScene(&random);
    const v1::Scenario mirrored = Mirrored(scenario);
    const Picture expected = Draw(spec, mirrored, kNow, kTarget, TargetOf(mirrored));
    Raster raster = NewRaster(spec);
    Rasterizer(spec).Rasterize(scenario, RoadMap::Over(scenario.map_features()), kNow, kTarget,
                               TargetOf(scenario), {}, &raster);
    const Picture before(spec, raster);
    EXPECT_GT(MeanDifference(before, expected), kMeanOfOtherPicture);
    raster.Mirror();
    const Picture turned(spec, raster);
    EXPECT_LT(MeanDifference(turned, expected), kMeanTolerance);
    EXPECT_LE(LargestDifference(turned, expected), kLargestTolerance);
    raster.Mirror();
    EXPECT_EQ(Picture(spec, raster).bytes(), before.bytes());
  }
}

TEST(RasterSymmetryTest, AViewMatchesTheRasterOfAScaledAndShiftedWorld) {
  // Scaling by k and shifting by whole pixels equals finer pixels and a shifted picture.
  std::mt19937_64 random(14);
  const v1::Scenario scenario = CrowdedScene(&random);
  const Pose2 X_WT = TargetOf(scenario);
  const v1::RasterSpec spec = Spec(64);
  v1::RasterSpec finer = spec;
  finer.set_meters_per_pixel(spec.meters_per_pixel() / 1.1);
  const Picture expected = Draw(finer, scenario, kNow, kTarget, X_WT);
  const RasterView view{.scale = 1.1, .shift_x = 2.0, .shift_y = -3.0};
  const Picture raster = Draw(spec, scenario, kNow, kTarget, X_WT, view);
  for (int row = 3; row < 64; ++row) {
    for (int column = 2; column < 80; ++column) {
      for (int channel = 0; channel < RasterChannels(spec); ++channel) {
        ASSERT_NEAR(raster.at(row, column, channel), expected.at(row - 3, column - 2, channel),
                    kSimplificationTolerance)
            << row << " " << column << " " << channel;
      }
    }
  }
}

}  // namespace
}  // namespace maneuver::scene::rasterizer_symmetry_test
