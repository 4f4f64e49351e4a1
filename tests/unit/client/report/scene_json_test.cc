#include "client/report/scene_json.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "tests/unit/client/report/made_up_report.h"

namespace maneuver::report::scene_json_test {
namespace {

using nlohmann::json;

std::vector<int> AllWaypoints() {
  std::vector<int> waypoints(kMadeUpWaypoints);
  for (int t = 0; t < kMadeUpWaypoints; ++t) waypoints[static_cast<size_t>(t)] = t;
  return waypoints;
}

json SceneOf(const Scene& scene) { return SceneJson(scene, AllWaypoints(), 5.0); }

TEST(SceneJsonTest, StatesAreInTheTargetsFrameAndCountedFromThePredictionTime) {
  Scene scene = MadeUpScene(0, "best");
  // The target stands at (0, 0) of its own frame, looking along +y of the world.
  scene.X_WT = scene::Pose2(0.0, 0.0, std::numbers::pi / 2);
  const json agents = SceneOf(scene)["agents"];
  ASSERT_EQ(agents.size(), 2);
  EXPECT_EQ(agents[0]["id"], "7");  // the target is first
  const json& states = agents[0]["states"];
  for (size_t i = 0; i + 3 < states.size(); i += 4) {
    const double time = states[i];
    EXPECT_GE(time, -1.0);
    EXPECT_LE(time, 5.0);
    EXPECT_NEAR(states[i + 1].get<double>(), 0.0, 1e-9);            // 10 m/s along +x of the world
    EXPECT_NEAR(states[i + 2].get<double>(), -10.0 * time, 0.011);  // is to the right of +y
    EXPECT_NEAR(states[i + 3].get<double>(), -std::numbers::pi / 2, 0.01);
  }
}

TEST(SceneJsonTest, IdsKeepAllTheirDigits) {
  EXPECT_EQ(SceneOf(MadeUpScene(0, "best"))["agents"][1]["id"], "9007199254740993");
}

TEST(SceneJsonTest, AStandingAgentHasOnlyItsFirstAndLastState) {
  const json agents = SceneOf(MadeUpScene(0, "best"))["agents"];
  ASSERT_EQ(agents[1]["states"].size(), 8);
  EXPECT_EQ(agents[1]["states"][0], -1.0);
  EXPECT_EQ(agents[1]["states"][4], 5.0);
}

TEST(SceneJsonTest, AStraightLaneHasTwoPointsInSight) {
  Scene scene = MadeUpScene(0, "best");
  auto recording = std::make_shared<v1::Scenario>(*scene.recording);
  v1::MapFeature* far = recording->add_map_features();
  far->set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  for (const double x : {1000.0, 1010.0}) {
    far->add_x(x);
    far->add_y(1000.0);
  }
  scene.recording = recording;
  const json map = SceneOf(scene)["map"];
  ASSERT_EQ(map["lane"].size(), 1);  // not the far one
  ASSERT_EQ(map["lane"][0].size(), 4);
  EXPECT_EQ(map["edge"].size(), 2);
  EXPECT_EQ(map["area"].size(), 1);
}

TEST(SceneJsonTest, ALaneAcrossTheViewIsDrawnIfItsPointsAreOutside) {
  Scene scene = MadeUpScene(0, "best");
  auto recording = std::make_shared<v1::Scenario>();
  const auto add = [&](double x0, double y0, double x1, double y1) {
    v1::MapFeature* lane = recording->add_map_features();
    lane->set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
    for (const double x : {x0, x1}) lane->add_x(x);
    for (const double y : {y0, y1}) lane->add_y(y);
  };
  add(-500.0, 2.0, 500.0, 2.0);
  add(-500.0, 0.0, 0.0, 500.0);  // passes by, more than 300 m away
  scene.recording = recording;
  const json lanes = SceneOf(scene)["map"].value("lane", json::array());
  ASSERT_EQ(lanes.size(), 1);
  EXPECT_EQ(lanes[0], json({-500.0, 2.0, 500.0, 2.0}));
}

TEST(SceneJsonTest, ASimplifiedCurveStaysWithinTheTolerance) {
  Scene scene = MadeUpScene(0, "best");
  auto recording = std::make_shared<v1::Scenario>();
  v1::MapFeature* lane = recording->add_map_features();
  lane->set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  constexpr double kRadius = 20.0;
  for (int i = 0; i <= 180; ++i) {
    const double angle = i * std::numbers::pi / 180.0;
    lane->add_x(kRadius * std::cos(angle));
    lane->add_y(kRadius * std::sin(angle));
  }
  scene.recording = recording;
  const json line = SceneOf(scene)["map"]["lane"][0];
  const size_t points = line.size() / 2;
  EXPECT_LT(points, 40);
  // Between two points of a circle the chord is off by its sagitta.
  for (size_t i = 0; i + 1 < points; ++i) {
    const double x = 0.5 * (line[2 * i].get<double>() + line[2 * i + 2].get<double>());
    const double y = 0.5 * (line[2 * i + 1].get<double>() + line[2 * i + 3].get<double>());
    EXPECT_NEAR(std::hypot(x, y), kRadius, 0.12 + 0.08);  // tolerance and rounding to 0.1 m
  }
}

TEST(SceneJsonTest, ASignalStandsAtTheStartOfItsLaneAndChangesWithTime) {
  const json signals = SceneOf(MadeUpScene(0, "best"))["signals"];
  ASSERT_EQ(signals.size(), 0);  // the lane begins 40 m behind, out of sight
  Scene scene = MadeUpScene(0, "best");
  auto recording = std::make_shared<v1::Scenario>(*scene.recording);
  recording->mutable_map_features(1)->set_x(0, -20.0);
  v1::TrafficSignalReading* later = recording->mutable_traffic_signals(0)->add_readings();
  later->set_time(4.0);
  later->set_state(v1::TRAFFIC_SIGNAL_STATE_STOP);
  scene.recording = recording;
  const json seen = SceneOf(scene)["signals"];
  ASSERT_EQ(seen.size(), 1);
  EXPECT_EQ(seen[0]["x"], -20.0);
  EXPECT_EQ(seen[0]["states"], json({-2.0, 3, 2.0, 1}));
}

}  // namespace
}  // namespace maneuver::report::scene_json_test
