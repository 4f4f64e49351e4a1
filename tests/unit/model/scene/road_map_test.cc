#include "model/scene/road_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::road_map_test {
namespace {

TEST(RoadMapTest, BoxesEncloseTheirFeatures) {
  v1::Scenario scenario;
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_ROAD_LINE, {{3.0, -1.0}, {-2.0, 5.0}, {0.0, 0.0}});
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_STOP_SIGN, {{7.0, 8.0}});
  const RoadMap map(scenario.map_features());
  ASSERT_EQ(map.boxes().size(), 2u);
  EXPECT_EQ(map.boxes()[0].low_x, -2.0);
  EXPECT_EQ(map.boxes()[0].low_y, -1.0);
  EXPECT_EQ(map.boxes()[0].high_x, 3.0);
  EXPECT_EQ(map.boxes()[0].high_y, 5.0);
  EXPECT_EQ(map.boxes()[1].low_x, map.boxes()[1].high_x);
  // At least 4 points of 16 bytes.
  EXPECT_GT(map.bytes(), 4 * 16);
}

// The points of a circle are R (1 - cos) from a chord, up to half way.
TEST(RoadMapTest, StretchesStateHowFarTheyBend) {
  constexpr double kRadius = 50.0;
  constexpr double kStep = 0.01;  // radians
  constexpr int kPoints = 40;
  constexpr int kIntervals = Stretches::kStretchPoints - 1;
  v1::Scenario scenario;
  v1::MapFeature* circle = AddFeature(&scenario, v1::MAP_FEATURE_TYPE_ROAD_EDGE, {});
  for (int i = 0; i < kPoints; ++i) {
    circle->add_x(200.0 + kRadius * std::cos(kStep * i));
    circle->add_y(-70.0 + kRadius * std::sin(kStep * i));
  }
  const RoadMap map(scenario.map_features());
  const auto stretches = map.stretches()[0];
  ASSERT_EQ(stretches.size(), 3u);
  for (size_t s = 0; s < stretches.size(); ++s) {
    const int first = static_cast<int>(s) * kIntervals;
    const int last = std::min(first + kIntervals, kPoints - 1);
    const double half = 0.5 * kStep * (last - first);
    // With an odd number of intervals, no point is half way.
    const double least = kRadius * (std::cos(kStep / 2) - std::cos(half));
    EXPECT_LE(std::sqrt(stretches[s].squared_bend), kRadius * (1.0 - std::cos(half)) + 1e-9);
    EXPECT_GE(std::sqrt(stretches[s].squared_bend), least - 1e-9);
    EXPECT_EQ(stretches[s].box.high_x, circle->x(first));
    EXPECT_EQ(stretches[s].box.low_x, circle->x(last));
    EXPECT_EQ(stretches[s].box.low_y, circle->y(first));
    EXPECT_EQ(stretches[s].box.high_y, circle->y(last));
  }
}

TEST(RoadMapTest, AStretchThatTurnsBackIsNotStraight) {
  v1::Scenario scenario;
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_ROAD_LINE, {{0, 0}, {5, 0}, {2, 0}});
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_ROAD_LINE, {{0, 0}, {5, 0}, {0, 0}});
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_ROAD_LINE, {{0, 0}, {5, 0}, {9, 0}});
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_ROAD_LINE, {});
  const RoadMap map(scenario.map_features());
  EXPECT_TRUE(std::isinf(map.stretches()[0][0].squared_bend));
  EXPECT_TRUE(std::isinf(map.stretches()[1][0].squared_bend));
  EXPECT_EQ(map.stretches()[2][0].squared_bend, 0.0);
  EXPECT_TRUE(map.stretches()[3].empty());
}

TEST(RoadMapTest, AMapOverFeaturesDoesNotCopyThem) {
  v1::Scenario scenario;
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_ROAD_LINE, {{3.0, -1.0}, {-2.0, 5.0}, {0.0, 0.0}});
  const RoadMap map = RoadMap::Over(scenario.map_features());
  EXPECT_EQ(&map.features(), &scenario.map_features());
  EXPECT_EQ(map.boxes()[0].high_y, 5.0);
  EXPECT_LT(map.bytes(), RoadMap(scenario.map_features()).bytes());
}

TEST(RoadMapTest, BoxesThatTouchOverlap) {
  const Box box{0.0, 0.0, 2.0, 1.0};
  EXPECT_TRUE(box.Overlaps({2.0, 1.0, 3.0, 3.0}));
  EXPECT_TRUE(box.Overlaps({-5.0, -5.0, 5.0, 5.0}));
  EXPECT_FALSE(box.Overlaps({2.1, 0.0, 3.0, 1.0}));
  EXPECT_FALSE(box.Overlaps({0.0, -2.0, 2.0, -0.1}));
}

// Every kind of feature, small and large, anywhere in and around the picture, from any direction.
TEST(RoadMapTest, ASharedMapGivesTheSamePictureAsTheScenariosOwn) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  v1::RasterSpec spec = SmallSpec();
  spec.set_target_position(0.3);
  int visible = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const Pose2 X_WT(1000.0 * uniform(random), 1000.0 * uniform(random), 4.0 * uniform(random));
    v1::Scenario own;
    AddState(AddAgent(&own, 1, v1::AGENT_TYPE_VEHICLE, 4.0, 2.0), 0.0, X_WT.x(), X_WT.y(),
             X_WT.heading());
    v1::TrafficSignal* signal = own.add_traffic_signals();
    signal->set_lane_id(1);
    signal->add_readings()->set_state(v1::TRAFFIC_SIGNAL_STATE_STOP);
    for (int type = v1::MAP_FEATURE_TYPE_LANE_CENTERLINE; type <= v1::MAP_FEATURE_TYPE_BIKE_LANE;
         ++type) {
      v1::MapFeature* feature = AddFeature(&own, static_cast<v1::MapFeatureType>(type), {});
      feature->set_id(type);
      const Point2 place = X_WT * Point2{20.0 * uniform(random), 20.0 * uniform(random)};
      const double size = std::exp(3.0 * uniform(random));
      const int points = type == v1::MAP_FEATURE_TYPE_STOP_SIGN ? 1 : 4;
      for (int i = 0; i < points; ++i) {
        feature->add_x(place.x + size * uniform(random));
        feature->add_y(place.y + size * uniform(random));
      }
    }
    v1::Scenario bare = own;
    bare.clear_map_features();
    const RoadMap map(own.map_features());
    const RasterView view{.scale = 1.0 + 0.3 * uniform(random),
                          .shift_x = 3.0 * uniform(random),
                          .shift_y = 3.0 * uniform(random)};
    const Picture expected = Draw(spec, own, 0.0, 1, X_WT, view);
    Raster shared = NewRaster(spec);
    Rasterizer(spec).Rasterize(bare, map, 0.0, 1, X_WT, view, &shared);
    ASSERT_EQ(Picture(spec, shared).bytes(), expected.bytes()) << "trial " << trial;
    visible += expected.Sum(kLaneChannel) > 0 || expected.Sum(kPlaceChannel) > 0;
  }
  EXPECT_GT(visible, 200);
}

}  // namespace
}  // namespace maneuver::scene::road_map_test
