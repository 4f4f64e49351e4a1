#include "model/scene/lane_paths.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "model/scene/road_map.h"
#include "tests/unit/model/scene/plain_lane_paths.h"
#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::lane_paths_test {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kTime = 3.0;
constexpr int64_t kTarget = 100;
// First numbers of each kind, repeated here on purpose.
constexpr int kPointsAt = 0, kCosinesAt = 26, kSinesAt = 39, kLookAheadAt = 52, kOffset = 62,
              kTurnSine = 63, kTurnCosine = 64, kLength = 65, kCost = 66, kFirst = 67,
              kSpeedLimit = 68, kLeader = 69, kGap = 70, kLeaderSpeed = 71, kSpeedDifference = 72,
              kCloseness = 73, kSignalAt = 74, kSignalDistance = 78, kStopCloseness = 79,
              kCautionCloseness = 80, kStopSign = 81, kStopSignDistance = 82,
              kStopSignCloseness = 83;
constexpr double kDistances[] = {2.5, 5, 7.5, 10, 15, 20, 25, 30, 40, 50, 65, 80, 100};

// A scene and the parameters of a call.
struct World {
  v1::Scenario scenario = {};
  Pose2 X_WT = {};
  double speed = 10.0;

  // Adds a lane through points of the target's frame.
  v1::MapFeature* AddLane(int64_t id, const std::vector<Point2>& points) {
    v1::MapFeature* lane = AddFeature(&scenario, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {});
    lane->set_id(id);
    for (const Point2& point : points) {
      const Point2 p_WP = X_WT * point;
      lane->add_x(p_WP.x);
      lane->add_y(p_WP.y);
    }
    return lane;
  }
  void AddStopSign(Point2 place) {
    place = X_WT * place;
    AddFeature(&scenario, v1::MAP_FEATURE_TYPE_STOP_SIGN, {place});
  }
  // Adds an agent at `place` in the target's frame at `time`, with a velocity in that frame.
  v1::Agent* AddOther(int64_t id, Point2 place, Point2 velocity, double time = kTime) {
    v1::Agent* agent = AddAgent(&scenario, id, v1::AGENT_TYPE_VEHICLE, 4.0, 2.0);
    AddStateOf(agent, time, place, velocity);
    return agent;
  }
  void AddStateOf(v1::Agent* agent, double time, Point2 place, Point2 velocity) {
    place = X_WT * place;
    AddState(agent, time, place.x, place.y, X_WT.heading());
    const Pose2 turn(0.0, 0.0, X_WT.heading());
    velocity = turn * velocity;
    agent->mutable_states()->rbegin()->set_velocity_x(static_cast<float>(velocity.x));
    agent->mutable_states()->rbegin()->set_velocity_y(static_cast<float>(velocity.y));
  }
  void AddSignal(int64_t lane, std::vector<std::pair<double, v1::TrafficSignalState>> readings) {
    v1::TrafficSignal* signal = scenario.add_traffic_signals();
    signal->set_lane_id(lane);
    for (const auto& [time, state] : readings) {
      v1::TrafficSignalReading* reading = signal->add_readings();
      reading->set_time(time);
      reading->set_state(state);
    }
  }
};

LanePathInputs Find(const World& world, const WorldView& view = {},
                    int version = kLatestInputsVersion) {
  LanePathInputs inputs;
  inputs.values.fill(7.0F);
  LanePathFinder(version).Find(world.scenario, RoadMap::Over(world.scenario.map_features()).lanes(),
                               kTime, kTarget, world.X_WT, world.speed, view, &inputs);
  return inputs;
}

float At(const LanePathInputs& inputs, int path, int number) {
  return inputs.values[static_cast<size_t>(path * kLanePathInputs + number)];
}

Point2 PointAt(const LanePathInputs& inputs, int path, int point) {
  const double divisor = std::max(kDistances[point], 5.0);
  return {divisor * At(inputs, path, kPointsAt + 2 * point),
          divisor * At(inputs, path, kPointsAt + 2 * point + 1)};
}

// Compares part of a row with the expected numbers.
void ExpectRow(const LanePathInputs& inputs, int path, const std::vector<double>& expected,
               double tolerance, const std::string& what) {
  ASSERT_EQ(expected.size(), static_cast<size_t>(kLanePathInputs));
  for (int i = 0; i < kLanePathInputs; ++i) {
    const double value = expected[static_cast<size_t>(i)];
    EXPECT_NEAR(At(inputs, path, i), value, tolerance * (1.0 + std::abs(value)))
        << what << ", path " << path << ", number " << i;
  }
}

void ExpectSame(const LanePathInputs& inputs, const LanePathInputs& expected, double tolerance,
                const std::string& what) {
  ASSERT_EQ(inputs.count, expected.count) << what;
  for (int path = 0; path < inputs.count; ++path) {
    const float* const row = expected.values.data() + path * kLanePathInputs;
    ExpectRow(inputs, path, {row, row + kLanePathInputs}, tolerance, what);
  }
}

std::vector<Point2> Line(Point2 from, Point2 to, double step = 1.0) {
  const double length = std::hypot(to.x - from.x, to.y - from.y);
  const int count = std::max(1, static_cast<int>(std::round(length / step)));
  std::vector<Point2> points;
  for (int i = 0; i <= count; ++i) {
    points.push_back({from.x + (to.x - from.x) * i / count, from.y + (to.y - from.y) * i / count});
  }
  return points;
}

TEST(LanePathsTest, DescribesAStraightLane) {
  World world{.X_WT = {30.0, -20.0, 0.4}, .speed = 12.0};
  world.AddLane(1, Line({-40.0, 1.25}, {70.0, 1.25}))->set_speed_limit(15.0);
  const LanePathInputs inputs = Find(world);
  ASSERT_EQ(inputs.count, 1);
  for (int i = 0; i < 13; ++i) {
    // Beyond its end at 70 m it continues straight.
    EXPECT_NEAR(PointAt(inputs, 0, i).x, kDistances[i], 1e-4);
    EXPECT_NEAR(PointAt(inputs, 0, i).y, 1.25, 1e-4);
    EXPECT_NEAR(At(inputs, 0, kCosinesAt + i), 1.0, 1e-6);
    EXPECT_NEAR(At(inputs, 0, kSinesAt + i), 0.0, 1e-6);
  }
  for (int t = 0; t < 5; ++t) {
    EXPECT_NEAR(At(inputs, 0, kLookAheadAt + 2 * t), 0.0, 1e-5);
    EXPECT_NEAR(At(inputs, 0, kLookAheadAt + 2 * t + 1), 0.125, 1e-5);
  }
  EXPECT_NEAR(At(inputs, 0, kOffset), -1.25, 1e-5);  // to the right of the lane
  EXPECT_NEAR(At(inputs, 0, kTurnSine), 0.0, 1e-6);
  EXPECT_NEAR(At(inputs, 0, kTurnCosine), 1.0, 1e-6);
  EXPECT_NEAR(At(inputs, 0, kLength), 70.0 / 50.0, 1e-5);
  EXPECT_NEAR(At(inputs, 0, kCost), 1.25 / 3.0, 1e-5);
  EXPECT_EQ(At(inputs, 0, kFirst), 1.0F);
  EXPECT_EQ(At(inputs, 0, kSpeedLimit), 1.0F);
  EXPECT_EQ(At(inputs, 0, kLeader), 0.0F);
  EXPECT_NEAR(At(inputs, 0, kGap), 100.0 / 30.0, 1e-6);
  EXPECT_EQ(At(inputs, 0, kLeaderSpeed), 0.0F);
  EXPECT_EQ(At(inputs, 0, kSpeedDifference), 0.0F);
  EXPECT_EQ(At(inputs, 0, kCloseness), 0.0F);
  for (int i = 0; i < 4; ++i) EXPECT_EQ(At(inputs, 0, kSignalAt + i), 0.0F);
  EXPECT_EQ(At(inputs, 0, kSignalDistance), 0.0F);
  EXPECT_EQ(At(inputs, 0, kStopCloseness), 0.0F);
  EXPECT_EQ(At(inputs, 0, kCautionCloseness), 0.0F);
  EXPECT_EQ(At(inputs, 0, kStopSign), 0.0F);
  EXPECT_EQ(At(inputs, 0, kStopSignDistance), 0.0F);
  EXPECT_EQ(At(inputs, 0, kStopSignCloseness), 0.0F);
  for (size_t i = kLanePathInputs; i < inputs.values.size(); ++i) {
    EXPECT_EQ(inputs.values[i], 0.0F);
  }
}

// The target is on a circle of radius R to the left, turned 10 degrees to the right of it.
TEST(LanePathsTest, DescribesAnArc) {
  constexpr double kRadius = 40.0;
  World world{.X_WT = {0.0, 0.0, -10.0 * kDegree}, .speed = 6.0};
  v1::MapFeature* lane = world.AddLane(1, {});
  for (double angle = -0.5; angle < 3.0; angle += 0.002) {
    lane->add_x(kRadius * std::sin(angle));
    lane->add_y(kRadius * (1.0 - std::cos(angle)));
  }
  const LanePathInputs inputs = Find(world);
  ASSERT_EQ(inputs.count, 1);
  const auto place = [&](double distance) {
    const double angle = distance / kRadius;
    return world.X_WT.ToLocal({kRadius * std::sin(angle), kRadius * (1.0 - std::cos(angle))});
  };
  for (int i = 0; i < 13; ++i) {
    EXPECT_NEAR(PointAt(inputs, 0, i).x, place(kDistances[i]).x, 2e-3);
    EXPECT_NEAR(PointAt(inputs, 0, i).y, place(kDistances[i]).y, 2e-3);
    const double turn = kDistances[i] / kRadius + 10.0 * kDegree;
    EXPECT_NEAR(At(inputs, 0, kCosinesAt + i), std::cos(turn), 2e-3);
    EXPECT_NEAR(At(inputs, 0, kSinesAt + i), std::sin(turn), 2e-3);
  }
  for (int t = 1; t <= 5; ++t) {
    EXPECT_NEAR(At(inputs, 0, kLookAheadAt + 2 * t - 2), (place(6.0 * t).x - 6.0 * t) / 10, 1e-3);
    EXPECT_NEAR(At(inputs, 0, kLookAheadAt + 2 * t - 1), place(6.0 * t).y / 10, 1e-3);
  }
  EXPECT_NEAR(At(inputs, 0, kTurnSine), std::sin(-10.0 * kDegree), 2e-3);
  EXPECT_NEAR(At(inputs, 0, kTurnCosine), std::cos(10.0 * kDegree), 2e-3);
  EXPECT_NEAR(3.0 * At(inputs, 0, kCost), 4.0 * (1.0 - std::cos(10.0 * kDegree)), 3e-3);
}

TEST(LanePathsTest, AStandingOrReversingTargetLooksAheadToItsFoot) {
  World world{.speed = -3.0};
  world.AddLane(1, Line({-10.0, 2.0}, {70.0, 2.0}));
  for (const double speed : {-3.0, 0.0}) {
    world.speed = speed;
    const LanePathInputs inputs = Find(world);
    for (int t = 0; t < 5; ++t) {
      EXPECT_NEAR(At(inputs, 0, kLookAheadAt + 2 * t), 0.0, 1e-6);
      EXPECT_NEAR(At(inputs, 0, kLookAheadAt + 2 * t + 1), 0.2, 1e-6);
    }
  }
}

TEST(LanePathsTest, StartsAreWithinFiveMetresAndSixtyDegrees) {
  const auto count = [](double distance, double heading) {
    World world;
    const Point2 along{std::cos(heading), std::sin(heading)};
    const Point2 foot{-distance * along.y, distance * along.x};
    world.AddLane(1, {{foot.x - 30 * along.x, foot.y - 30 * along.y},
                      {foot.x + 30 * along.x, foot.y + 30 * along.y}});
    return Find(world).count;
  };
  EXPECT_EQ(count(4.99, 0.0), 1);
  EXPECT_EQ(count(5.01, 0.0), 0);
  EXPECT_EQ(count(-4.99, 0.0), 1);
  EXPECT_EQ(count(0.0, 59.5 * kDegree), 1);
  EXPECT_EQ(count(0.0, -59.5 * kDegree), 1);
  EXPECT_EQ(count(0.0, 60.5 * kDegree), 0);
  EXPECT_EQ(count(0.0, 180.0 * kDegree), 0);
  World world;  // a lane that begins 4 m ahead
  world.AddLane(1, {{4.0, 0.0}, {50.0, 0.0}});
  EXPECT_EQ(Find(world).count, 1);
  EXPECT_NEAR(PointAt(Find(world), 0, 0).x, 6.5, 1e-5);
  EXPECT_NEAR(3.0 * At(Find(world), 0, kCost), 4.0, 1e-5);
}

TEST(LanePathsTest, OrdersStartsByCost) {
  World world;
  world.AddLane(1, Line({-20.0, 3.0}, {150.0, 3.0}));
  world.AddLane(2, Line({-20.0, -0.5}, {150.0, -0.5}));
  world.AddLane(3, Line({-20.0, -4.0}, {150.0, -4.0}));
  const LanePathInputs inputs = Find(world);
  ASSERT_EQ(inputs.count, 3);
  EXPECT_NEAR(PointAt(inputs, 0, 0).y, -0.5, 1e-5);
  EXPECT_NEAR(PointAt(inputs, 1, 0).y, 3.0, 1e-5);
  EXPECT_NEAR(PointAt(inputs, 2, 0).y, -4.0, 1e-5);
  EXPECT_EQ(At(inputs, 0, kFirst), 1.0F);
  EXPECT_EQ(At(inputs, 1, kFirst), 0.0F);
  EXPECT_NEAR(At(inputs, 0, kLength), 110.0 / 50.0, 1e-6);
}

TEST(LanePathsTest, AForkGivesAPathForEachBranch) {
  World world;
  world.AddLane(1, Line({-20.0, 0.0}, {20.0, 0.0}));
  world.AddLane(2, Line({20.0, 0.0}, {60.0, 20.0}));
  world.AddLane(3, Line({20.0, 0.0}, {60.0, -20.0}));
  const LanePathInputs inputs = Find(world);
  ASSERT_EQ(inputs.count, 2);
  for (const int path : {0, 1}) {
    const double side = path == 0 ? 1.0 : -1.0;
    EXPECT_NEAR(PointAt(inputs, path, 4).x, 15.0, 1e-4);
    const double beyond = (30.0 - 20.0) / std::sqrt(5.0);
    EXPECT_NEAR(PointAt(inputs, path, 7).x, 20.0 + 2.0 * beyond, 1e-4);
    EXPECT_NEAR(PointAt(inputs, path, 7).y, side * beyond, 1e-4);
    EXPECT_NEAR(At(inputs, path, kSinesAt + 7), side / std::sqrt(5.0), 1e-6);
    EXPECT_NEAR(At(inputs, path, kLength), (20.0 + std::sqrt(2000.0)) / 50.0, 1e-5);
  }
}

TEST(LanePathsTest, DropsPathsThatStayCloseToAnEarlierOne) {
  const auto count = [](double apart) {
    World world;
    world.AddLane(1, Line({-20.0, 0.0}, {150.0, 0.0}));
    world.AddLane(2, Line({-20.0, apart}, {150.0, apart}));
    return Find(world).count;
  };
  EXPECT_EQ(count(1.45), 1);
  EXPECT_EQ(count(1.55), 2);
  // A merge: the two paths differ before it.
  World world;
  world.AddLane(1, Line({-20.0, 0.0}, {40.0, 0.0}));
  world.AddLane(2, Line({-20.0, 5.0}, {40.0, 0.0}));
  world.AddLane(3, Line({40.0, 0.0}, {90.0, 0.0}));
  const LanePathInputs inputs = Find(world);
  ASSERT_EQ(inputs.count, 2);
  EXPECT_NEAR(PointAt(inputs, 0, 11).y, 0.0, 1e-4);
  EXPECT_NEAR(PointAt(inputs, 1, 11).y, 0.0, 1e-4);
}

TEST(LanePathsTest, AWayHasOnePathNearABorderBetweenItsLanes) {
  for (const double border : {-4.5, -3.0, -1.0, 0.0, 1.0, 3.0, 4.5}) {
    World world;
    world.AddLane(1, Line({-40.0, 0.5}, {border, 0.5}, 0.5));
    world.AddLane(2, Line({border, 0.5}, {150.0, 0.5}));
    const LanePathInputs inputs = Find(world);
    ASSERT_EQ(inputs.count, 1) << border;
    for (int i = 0; i < 13; ++i) {
      EXPECT_NEAR(PointAt(inputs, 0, i).x, kDistances[i], 1e-4) << border;
    }
    EXPECT_EQ(Find(world, {}, 1).count, std::abs(border) > 1.5 ? 2 : 1) << border;
  }
  // Lanes that nothing continues, and those that nothing leads to, have paths of their own.
  World world;
  world.AddLane(1, Line({-40.0, 0.0}, {-3.0, 0.0}));
  world.AddLane(2, Line({4.0, 2.0}, {150.0, 2.0}));
  EXPECT_EQ(Find(world).count, 2);
}

TEST(LanePathsTest, ASecondPathOfAWayDisplacesNoNeighbouringLane) {
  World world;  // 3 m after a border; the lane divides in three; another one runs beside it
  world.AddLane(1, Line({-40.0, 0.0}, {-3.0, 0.0}));
  world.AddLane(2, Line({-3.0, 0.0}, {20.0, 0.0}));
  for (const double heading : {-0.4, 0.0, 0.4}) {
    world.AddLane(0,
                  Line({20.0, 0.0}, {20.0 + 120.0 * std::cos(heading), 120.0 * std::sin(heading)}));
  }
  world.AddLane(9, Line({-40.0, 3.5}, {150.0, 3.5}));
  const LanePathInputs inputs = Find(world);
  ASSERT_EQ(inputs.count, 4);
  EXPECT_NEAR(PointAt(inputs, 3, 12).y, 3.5, 1e-4);
}

TEST(LanePathsTest, KeepsAtMostFivePathsPerStartAndSixInTotal) {
  World world;
  world.AddLane(1, Line({-20.0, 0.0}, {15.0, 0.0}));
  // Four branches, each of which forks twice.
  int64_t id = 2;
  for (const double first : {-0.4, -0.2, 0.2, 0.4}) {
    const Point2 end{15.0 + 40.0 * std::cos(first), 40.0 * std::sin(first)};
    world.AddLane(id++, Line({15.0, 0.0}, end));
    for (const double second : {-0.3, 0.3}) {
      world.AddLane(id++, Line(end, {end.x + 80.0 * std::cos(first + second),
                                     end.y + 80.0 * std::sin(first + second)}));
    }
  }
  EXPECT_EQ(Find(world).count, 5);
  world.AddLane(id++, Line({-20.0, 4.0}, {150.0, 4.0}));
  EXPECT_EQ(Find(world).count, 6);
  world.AddLane(id++, Line({-20.0, -4.5}, {150.0, -4.5}));
  EXPECT_EQ(Find(world).count, 6);
}

TEST(LanePathsTest, FollowsAtMostFourSuccessorsPerLane) {
  World world;
  world.AddLane(1, Line({-20.0, 0.0}, {10.0, 0.0}));
  for (int way = 0; way < 5; ++way) {
    const double heading = 0.5 - 0.25 * way;
    world.AddLane(2 + way,
                  Line({10.0, 0.0}, {10.0 + 120.0 * std::cos(heading), 120.0 * std::sin(heading)}));
  }
  const LanePathInputs inputs = Find(world);
  ASSERT_EQ(inputs.count, 4);
  for (int way = 0; way < 4; ++way) {
    EXPECT_NEAR(PointAt(inputs, way, 12).y, 90.0 * std::sin(0.5 - 0.25 * way), 1e-3);
  }
}

TEST(LanePathsTest, DeclaredSuccessorsDecideHowAPathContinues) {
  World world;
  world.AddLane(1, Line({-20.0, 0.0}, {20.0, 0.0}));
  world.AddLane(2, Line({20.0, 0.0}, {60.0, 20.0}));
  world.AddLane(3, Line({20.0, 0.0}, {60.0, -20.0}));
  world.AddLane(4, Line({22.0, 0.0}, {120.0, 0.0}));  // 2 m further on
  world.scenario.mutable_map_features(0)->add_successor_ids(4);
  const LanePathInputs inputs = Find(world);
  ASSERT_EQ(inputs.count, 1);
  EXPECT_NEAR(PointAt(inputs, 0, 12).x, 100.0, 1e-3);
  EXPECT_NEAR(PointAt(inputs, 0, 12).y, 0.0, 1e-3);
  EXPECT_NEAR(At(inputs, 0, kLength), 110.0 / 50.0, 1e-5);
}

TEST(LanePathsTest, CrossesAGapBetweenLanesStraight) {
  World world;
  world.AddLane(1, Line({-20.0, 0.0}, {13.0, 0.0}));
  world.AddLane(2, Line({13.0, 4.0}, {120.0, 4.0}));
  world.scenario.mutable_map_features(0)->add_successor_ids(2);
  const LanePathInputs inputs = Find(world);
  ASSERT_EQ(inputs.count, 1);
  EXPECT_NEAR(PointAt(inputs, 0, 4).x, 13.0, 1e-4);
  EXPECT_NEAR(PointAt(inputs, 0, 4).y, 2.0, 1e-4);
  EXPECT_NEAR(At(inputs, 0, kCosinesAt + 4), 1.0, 1e-6);  // the heading of the second lane
  EXPECT_NEAR(PointAt(inputs, 0, 5).x, 16.0, 1e-4);
  EXPECT_NEAR(PointAt(inputs, 0, 5).y, 4.0, 1e-4);
}

TEST(LanePathsTest, TheLeaderIsTheFirstAgentOnThePath) {
  World world{.X_WT = {5.0, 6.0, 2.0}, .speed = 12.0};
  world.AddLane(1, Line({-20.0, 0.5}, {150.0, 0.5}));
  AddState(AddAgent(&world.scenario, kTarget, v1::AGENT_TYPE_VEHICLE, 5.0, 2.0), kTime, 5.0, 6.0,
           2.0);
  world.AddOther(1, {40.0, 0.0}, {3.0, 0.0});
  world.AddOther(2, {30.0, 2.2}, {8.0, 1.0});                // 1.7 m to the left
  world.AddOther(3, {20.0, 2.4}, {3.0, 0.0});                // 1.9 m to the left
  world.AddOther(4, {1.4, 0.5}, {3.0, 0.0});                 // beside the target
  world.AddOther(5, {-5.0, 0.5}, {3.0, 0.0});                // behind
  world.AddOther(6, {10.0, 0.5}, {3.0, 0.0}, kTime - 0.13);  // no longer present
  const LanePathInputs inputs = Find(world);
  ASSERT_EQ(inputs.count, 1);
  const double gap = 30.0 - 0.5 * (4.0 + 5.0);
  EXPECT_EQ(At(inputs, 0, kLeader), 1.0F);
  EXPECT_NEAR(At(inputs, 0, kGap), gap / 30.0, 1e-5);
  EXPECT_NEAR(At(inputs, 0, kLeaderSpeed), 0.8, 1e-5);
  EXPECT_NEAR(At(inputs, 0, kSpeedDifference), -0.4, 1e-5);
  EXPECT_NEAR(At(inputs, 0, kCloseness), std::exp(-gap / 15.0), 1e-5);
}

TEST(LanePathsTest, ALeaderGoesOnFromAStateThatIsALittleOld) {
  World world{.X_WT = {5.0, 6.0, 2.0}};
  world.AddLane(1, Line({-20.0, 0.5}, {150.0, 0.5}));
  world.AddOther(1, {30.0, 0.5}, {12.0, 0.0}, kTime - 0.1);
  const double half_length = 0.5 * 4.0;
  EXPECT_NEAR(At(Find(world), 0, kGap), (30.0 + 1.2 - half_length) / 30.0, 1e-5);
  EXPECT_EQ(At(Find(world, {}, /*version=*/2), 0, kLeader), 0.0F);
}

TEST(LanePathsTest, InEarlierVersionsWhatIsNotThereIs100MetresAway) {
  World world;
  world.AddLane(1, Line({-20.0, 0.5}, {150.0, 0.5}));
  for (const int version : {0, 1, 2}) {
    const LanePathInputs inputs = Find(world, {}, version);
    EXPECT_NEAR(At(inputs, 0, kSignalDistance), 100.0 / 30.0, 1e-6);
    EXPECT_NEAR(At(inputs, 0, kStopSignDistance), 100.0 / 30.0, 1e-6);
  }
}

TEST(LanePathsTest, ALeaderThatTouchesTheTargetHasTheLargestCloseness) {
  World world;
  world.AddLane(1, Line({-20.0, 0.0}, {150.0, 0.0}));
  AddState(AddAgent(&world.scenario, kTarget, v1::AGENT_TYPE_VEHICLE, 5.0, 2.0), kTime, 0, 0, 0);
  world.AddOther(1, {2.0, 0.0}, {0.0, 0.0})->set_length(1'000.0);
  const LanePathInputs inputs = Find(world);
  EXPECT_NEAR(At(inputs, 0, kGap), (2.0 - 502.5) / 30.0, 1e-4);
  EXPECT_EQ(At(inputs, 0, kCloseness), 1.0F);
}

TEST(LanePathsTest, SearchesLeadersUpToEightyMetresAlongThePath) {
  const auto leads = [](double x) {
    World world;
    world.AddLane(1, Line({-20.0, 0.0}, {150.0, 0.0}));
    world.AddOther(1, {x, 0.0}, {0.0, 0.0});
    return At(Find(world), 0, kLeader) == 1.0F;
  };
  EXPECT_FALSE(leads(1.4));
  EXPECT_TRUE(leads(1.6));
  EXPECT_TRUE(leads(81.7));  // 1.7 m from the path's point at 80 m
  EXPECT_FALSE(leads(81.9));
}

TEST(LanePathsTest, TheFirstLaneWithASignalCounts) {
  World world;
  world.AddLane(1, Line({-2.5, 0.0}, {20.0, 0.0}));
  world.AddLane(2, Line({20.0, 0.0}, {40.0, 0.0}));
  world.AddLane(3, Line({40.0, 0.0}, {150.0, 0.0}));
  const auto expect = [&](int column, double distance) {
    const LanePathInputs inputs = Find(world);
    for (int i = 0; i < 4; ++i) {
      EXPECT_EQ(At(inputs, 0, kSignalAt + i), i == column ? 1.0F : 0.0F);
    }
    EXPECT_NEAR(At(inputs, 0, kSignalDistance), (distance - 100.0) / 30.0, 1e-5);
    const double closeness = std::exp(-std::max(distance, 0.0) / 15.0);
    EXPECT_NEAR(At(inputs, 0, kStopCloseness), column == 1 ? closeness : 0.0, 1e-5);
    EXPECT_NEAR(At(inputs, 0, kCautionCloseness), column == 2 ? closeness : 0.0, 1e-5);
  };
  world.AddSignal(0, {{0.0, v1::TRAFFIC_SIGNAL_STATE_STOP}});  // of no lane
  world.AddSignal(2, {{kTime + 0.1, v1::TRAFFIC_SIGNAL_STATE_STOP}});
  expect(-1, 100.0);
  world.AddSignal(3, {{0.0, v1::TRAFFIC_SIGNAL_STATE_GO}});
  expect(3, 40.0);
  world.AddSignal(3, {{0.0, v1::TRAFFIC_SIGNAL_STATE_GO},
                      {2.0, v1::TRAFFIC_SIGNAL_STATE_STOP},
                      {3.0, v1::TRAFFIC_SIGNAL_STATE_CAUTION},
                      {3.1, v1::TRAFFIC_SIGNAL_STATE_STOP}});
  expect(2, 40.0);
  world.AddSignal(2, {{0.0, v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED}});
  expect(0, 20.0);
  world.AddSignal(2, {{0.0, v1::TRAFFIC_SIGNAL_STATE_STOP}});
  expect(1, 20.0);
  world.AddSignal(1, {{0.0, v1::TRAFFIC_SIGNAL_STATE_STOP}});
  expect(1, -2.5);
  // A lane that began more than 3 m behind has already been entered.
  const Point2 start = world.X_WT * Point2{-3.5, 0.0};
  world.scenario.mutable_map_features(0)->set_x(0, start.x);
  world.scenario.mutable_map_features(0)->set_y(0, start.y);
  expect(1, 20.0);
}

TEST(LanePathsTest, TheFirstStopSignBesideThePathCounts) {
  World world{.X_WT = {-3.0, 8.0, -1.0}};
  world.AddLane(1, Line({-20.0, 0.0}, {150.0, 0.0}));
  world.AddStopSign({-8.0, 0.0});  // passed
  world.AddStopSign({12.0, 7.1});
  EXPECT_EQ(At(Find(world), 0, kStopSign), 0.0F);
  world.AddStopSign({40.0, 3.0});
  world.AddStopSign({25.0, -6.9});
  LanePathInputs inputs = Find(world);
  EXPECT_EQ(At(inputs, 0, kStopSign), 1.0F);
  EXPECT_NEAR(At(inputs, 0, kStopSignDistance), (25.0 - 100.0) / 30.0, 1e-5);
  EXPECT_NEAR(At(inputs, 0, kStopSignCloseness), std::exp(-2.5), 1e-5);
  world.AddStopSign({-0.5, 5.0});  // just beside the target
  inputs = Find(world);
  EXPECT_NEAR(At(inputs, 0, kStopSignDistance), -100.5 / 30.0, 1e-5);
  EXPECT_NEAR(At(inputs, 0, kStopSignCloseness), std::exp(-0.05), 1e-5);
}

// A world of lanes that leave the target's surroundings in all directions, fork, merge and have
// gaps, with agents, signals and stop signs along them.
//   all_declared: whether every lane declares its successors
World RandomWorld(std::mt19937& random, bool all_declared) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const auto below = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  World world{.X_WT = {1e4 * uniform(random), 1e4 * uniform(random), 3.0 * uniform(random)},
              .speed = 8.0 + 12.0 * uniform(random)};
  struct Tip {
    Point2 end;
    double heading;
    int lane;  // -1: none
  };
  std::vector<Tip> tips;
  const int roots = 1 + below(4);
  for (int i = 0; i < roots; ++i) {
    tips.push_back(
        {{-15.0 + 10.0 * uniform(random), 6.0 * uniform(random)}, 0.7 * uniform(random), -1});
  }
  std::vector<Point2> places;  // on lanes
  for (size_t t = 0; t < tips.size() && world.scenario.map_features_size() < 30; ++t) {
    const Tip tip = tips[t];
    const double bend = 0.03 * uniform(random);
    const double step = 2.0 + 1.5 * uniform(random);
    Point2 point = tip.end;
    double heading = tip.heading;
    std::vector<Point2> points = {point};
    const int count = 2 + below(25);
    for (int i = 0; i < count; ++i) {
      point = {point.x + step * std::cos(heading), point.y + step * std::sin(heading)};
      heading += bend * step;
      points.push_back(point);
      if (below(8) == 0) points.push_back(point);  // twice
      if (below(4) == 0) places.push_back(point);
    }
    const int lane = world.scenario.map_features_size();
    v1::MapFeature* feature = world.AddLane(lane + 1, points);
    feature->set_speed_limit(10.0 + 5.0 * uniform(random));
    if (tip.lane >= 0 && (all_declared || below(2) == 0)) {
      world.scenario.mutable_map_features(tip.lane)->add_successor_ids(lane + 1);
    }
    const double gap = below(2) == 0 ? 0.0 : 0.35;
    for (int ways = below(4); ways > 0; --ways) {
      tips.push_back({{point.x + gap * uniform(random), point.y + gap * uniform(random)},
                      heading - bend * step + 0.5 * uniform(random),
                      lane});
    }
  }
  AddState(AddAgent(&world.scenario, kTarget, v1::AGENT_TYPE_VEHICLE, 4.8, 2.0), kTime,
           world.X_WT.x(), world.X_WT.y(), world.X_WT.heading());
  for (int id = 1; id <= 8; ++id) {
    const auto place = [&] {
      const Point2 on = places.empty() ? Point2{} : places[random() % places.size()];
      return Point2{on.x + 2.5 * uniform(random), on.y + 2.5 * uniform(random)};
    };
    const Point2 velocity{10.0 * uniform(random), 10.0 * uniform(random)};
    v1::Agent* agent = world.AddOther(id, place(), velocity, kTime - 0.1);
    agent->set_length(3.0 + uniform(random));
    if (id % 4 != 0) world.AddStateOf(agent, kTime - 0.04 * (id % 2), place(), velocity);
    world.AddStateOf(agent, kTime + 0.03, place(), velocity);
  }
  for (int i = 0; i < 4; ++i) {
    if (!places.empty()) world.AddStopSign(places[random() % places.size()]);
    world.AddSignal(1 + below(12),
                    {{0.1 * below(40), static_cast<v1::TrafficSignalState>(below(4))},
                     {4.0 + i, v1::TRAFFIC_SIGNAL_STATE_STOP}});
  }
  return world;
}

TEST(LanePathsTest, InputsMatchAPlainImplementation) {
  std::mt19937 random(11);
  LanePathFinder finders[] = {LanePathFinder(1), LanePathFinder(2), LanePathFinder(3)};
  int dropped = 0;
  int paths = 0, several = 0, leaders = 0, signals = 0, stop_signs = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const World world = RandomWorld(random, trial % 2 == 0);
    const RoadMap map = RoadMap::Over(world.scenario.map_features());
    LanePathInputs inputs;
    for (const int version : {1, 2, 3}) {
      const int before = version == 2 ? inputs.count : 0;
      finders[version - 1].Find(world.scenario, map.lanes(), kTime, kTarget, world.X_WT,
                                world.speed, {}, &inputs);
      dropped += inputs.count < before;
      const auto expected =
          PlainLanePaths(world.scenario, kTime, kTarget, world.X_WT, world.speed, version);
      ASSERT_EQ(inputs.count, static_cast<int>(expected.size())) << "trial " << trial;
      for (int path = 0; path < inputs.count; ++path) {
        ExpectRow(inputs, path, expected[static_cast<size_t>(path)], 1e-5,
                  "trial " + std::to_string(trial));
      }
    }
    for (int path = 0; path < inputs.count; ++path) {
      leaders += At(inputs, path, kLeader) == 1.0F;
      stop_signs += At(inputs, path, kStopSign) == 1.0F;
      for (int i = 0; i < 4; ++i) signals += At(inputs, path, kSignalAt + i) == 1.0F;
    }
    paths += inputs.count;
    several += inputs.count > 2;
  }
  EXPECT_GT(paths, 600);
  EXPECT_GT(several, 80);
  EXPECT_GT(leaders, 200);
  EXPECT_GT(signals, 200);
  EXPECT_GT(stop_signs, 200);
  EXPECT_GT(dropped, 20);
}

// Returns the world after every point goes through `move` and every direction through `turn`, with
// lengths and speeds `scale` times as large.
World Changed(const World& world, double scale, const std::function<Point2(Point2)>& move,
              const std::function<Point2(Point2)>& turn) {
  World changed = world;
  for (v1::MapFeature& feature : *changed.scenario.mutable_map_features()) {
    for (int i = 0; i < feature.x_size(); ++i) {
      const Point2 point = move({feature.x(i), feature.y(i)});
      feature.set_x(i, point.x);
      feature.set_y(i, point.y);
    }
    feature.set_speed_limit(scale * feature.speed_limit());
  }
  for (v1::Agent& agent : *changed.scenario.mutable_agents()) {
    agent.set_length(scale * agent.length());
    for (v1::AgentState& state : *agent.mutable_states()) {
      const Point2 point = move({state.x(), state.y()});
      state.set_x(point.x);
      state.set_y(point.y);
      const Point2 velocity = turn({state.velocity_x(), state.velocity_y()});
      state.set_velocity_x(static_cast<float>(scale * velocity.x));
      state.set_velocity_y(static_cast<float>(scale * velocity.y));
    }
  }
  changed.speed = scale * world.speed;
  const Point2 origin = move({world.X_WT.x(), world.X_WT.y()});
  const Point2 ahead = turn({world.X_WT.cosine(), world.X_WT.sine()});
  changed.X_WT = Pose2(origin.x, origin.y, std::atan2(ahead.y, ahead.x));
  return changed;
}

TEST(LanePathsTest, AViewGivesTheInputsOfAScaledWorld) {
  std::mt19937 random(12);
  int paths = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const World world = RandomWorld(random, true);
    const double scale = trial % 2 == 0 ? 1.13 : 0.88;
    const Pose2 X_WT = world.X_WT;
    const World scaled = Changed(
        world, scale,
        [&](Point2 p) {
          const Point2 p_TP = X_WT.ToLocal(p);
          return X_WT * Point2{scale * p_TP.x, scale * p_TP.y};
        },
        [](Point2 v) { return v; });
    const LanePathInputs inputs = Find(world, {.scale = scale});
    ExpectSame(inputs, Find(scaled), 1e-5, "trial " + std::to_string(trial));
    paths += inputs.count;
  }
  EXPECT_GT(paths, 300);
}

TEST(LanePathsTest, AViewGivesTheInputsOfAMirroredWorld) {
  std::mt19937 random(13);
  for (int trial = 0; trial < 200; ++trial) {
    const World world = RandomWorld(random, trial % 2 == 0);
    const Pose2 X_WT = world.X_WT;
    const Pose2 direction(0.0, 0.0, X_WT.heading());
    const World mirrored = Changed(
        world, 1.0,
        [&](Point2 p) {
          const Point2 p_TP = X_WT.ToLocal(p);
          return X_WT * Point2{p_TP.x, -p_TP.y};
        },
        [&](Point2 v) {
          const Point2 local = direction.ToLocal(v);
          return direction * Point2{local.x, -local.y};
        });
    ExpectSame(Find(world, {.mirror = true}), Find(mirrored), 1e-5,
               "trial " + std::to_string(trial));
  }
}

TEST(LanePathsTest, MovingTheWholeWorldChangesNothing) {
  std::mt19937 random(14);
  for (int trial = 0; trial < 200; ++trial) {
    const World world = RandomWorld(random, trial % 2 == 0);
    const Pose2 motion(-3000.0, 500.0, 2.1 + 0.1 * trial);
    const Pose2 direction(0.0, 0.0, motion.heading());
    const World moved = Changed(
        world, 1.0, [&](Point2 p) { return motion * p; }, [&](Point2 v) { return direction * v; });
    ExpectSame(Find(moved), Find(world), 1e-5, "trial " + std::to_string(trial));
  }
}

TEST(LanePathsTest, ReadsNothingLater) {
  std::mt19937 random(15);
  for (int trial = 0; trial < 50; ++trial) {
    const World world = RandomWorld(random, false);
    World past = world;
    for (v1::Agent& agent : *past.scenario.mutable_agents()) {
      while (!agent.states().empty() && agent.states().rbegin()->time() > kTime) {
        agent.mutable_states()->RemoveLast();
      }
    }
    for (v1::TrafficSignal& signal : *past.scenario.mutable_traffic_signals()) {
      while (!signal.readings().empty() && signal.readings().rbegin()->time() > kTime) {
        signal.mutable_readings()->RemoveLast();
      }
    }
    EXPECT_EQ(Find(past).values, Find(world).values) << "trial " << trial;
  }
}

TEST(LanePathsTest, UsesTheGivenFrameAndNotTheTargetsState) {
  std::mt19937 random(16);
  World world = RandomWorld(random, true);
  const LanePathInputs inputs = Find(world);
  for (v1::Agent& agent : *world.scenario.mutable_agents()) {
    if (agent.id() != kTarget) continue;
    agent.mutable_states(0)->set_heading(1.0F);
    agent.mutable_states(0)->set_x(0.0);
    agent.mutable_states(0)->set_velocity_x(50.0F);
  }
  EXPECT_EQ(Find(world).values, inputs.values);
}

TEST(LanePathsTest, AReusedFinderGivesTheSameBits) {
  std::mt19937 random(17);
  LanePathFinder finder;
  for (int trial = 0; trial < 100; ++trial) {
    const World world = RandomWorld(random, trial % 2 == 0);
    const RoadMap map = RoadMap::Over(world.scenario.map_features());
    LanePathInputs inputs;
    finder.Find(world.scenario, map.lanes(), kTime, kTarget, world.X_WT, world.speed, {}, &inputs);
    const LanePathInputs fresh = Find(world);
    EXPECT_EQ(inputs.count, fresh.count);
    EXPECT_EQ(inputs.values, fresh.values);
  }
}

TEST(LanePathsTest, DescribesTheSamePathsForDrawing) {
  std::mt19937 random(18);
  int paths = 0;
  for (int trial = 0; trial < 50; ++trial) {
    const World world = RandomWorld(random, trial % 2 == 0);
    const LanePathInputs inputs = Find(world);
    const RoadMap map = RoadMap::Over(world.scenario.map_features());
    const std::vector<LanePath> described =
        LanePathFinder().Describe(world.scenario, map.lanes(), kTime, kTarget, world.X_WT);
    ASSERT_EQ(static_cast<int>(described.size()), inputs.count);
    for (int i = 0; i < inputs.count; ++i) {
      const LanePath& path = described[static_cast<size_t>(i)];
      EXPECT_NEAR(path.cost, 3.0 * At(inputs, i, kCost), 1e-5);
      EXPECT_EQ(path.leader.has_value(), At(inputs, i, kLeader) == 1.0F);
      EXPECT_EQ(path.stop_sign.has_value(), At(inputs, i, kStopSign) == 1.0F);
      EXPECT_EQ(path.signal.has_value(), At(inputs, i, kSignalDistance) != 0.0F);
      if (path.signal) {
        EXPECT_EQ(At(inputs, i, kSignalAt + path.signal_state), 1.0F);
      }
      // It is as long as stated and ends at the last point.
      double length = 0.0;
      for (size_t k = 1; k < path.points.size(); ++k) {
        length += std::hypot(path.points[k].x - path.points[k - 1].x,
                             path.points[k].y - path.points[k - 1].y);
      }
      EXPECT_NEAR(length, 100.0, 2e-3);
      const Point2 last = world.X_WT.ToLocal(path.points.back());
      EXPECT_NEAR(last.x, PointAt(inputs, i, 12).x, 1e-3);
      EXPECT_NEAR(last.y, PointAt(inputs, i, 12).y, 1e-3);
      ++paths;
    }
  }
  EXPECT_GT(paths, 80);
}

double Seconds(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Finds the paths of a hostile map in time. The limit of a twentieth of a second is about twenty
// times the usual time.
LanePathInputs FindInTime(const World& world) {
  const RoadMap map = RoadMap::Over(world.scenario.map_features());
  LanePathFinder finder;
  LanePathInputs inputs;
  double seconds = 1.0;
  for (int attempt = 0; attempt < 5 && seconds > 0.05; ++attempt) {
    seconds = Seconds([&] {
      finder.Find(world.scenario, map.lanes(), kTime, kTarget, world.X_WT, world.speed, {},
                  &inputs);
    });
  }
  EXPECT_LE(seconds, 0.05);
  for (const float value : inputs.values) EXPECT_TRUE(std::isfinite(value));
  return inputs;
}

TEST(LanePathsTest, FollowsALoopOnce) {
  World world;
  // A ring of 40 m in two lanes, and a lane that is its own successor.
  world.AddLane(1, {{0, 0}, {5, 3}, {10, 3}})->add_successor_ids(2);
  world.AddLane(2, {{10, 3}, {10, -9}, {0, -9}, {0, 0}})->add_successor_ids(1);
  v1::MapFeature* own = world.AddLane(3, {{-3, -3}, {9, -3}, {9, -4}, {-3, -4}, {-3, -3}});
  own->add_successor_ids(3);
  const LanePathInputs inputs = FindInTime(world);
  EXPECT_GE(inputs.count, 2);
  for (int i = 0; i < inputs.count; ++i) EXPECT_LT(At(inputs, i, kLength), 60.0 / 50.0);
}

// Every lane is half a metre long and has 64 successors: all lanes of the map.
TEST(LanePathsTest, ForksWithoutEndTakeBoundedTime) {
  World world;
  for (int i = 0; i < 400; ++i) {
    v1::MapFeature* lane = world.AddLane(1 + i, {{0.0, 0.0}, {0.5, 0.001 * i}});
    for (int k = 0; k < 64; ++k) lane->add_successor_ids(1 + (i * 7 + k) % 400);
  }
  EXPECT_GE(FindInTime(world).count, 1);
}

TEST(LanePathsTest, ATreeOfForksTakesBoundedTime) {
  World world;
  int64_t id = 1;
  std::vector<std::pair<Point2, double>> ends = {{{0.0, 0.0}, 0.0}};
  for (int level = 0; level < 7; ++level) {
    std::vector<std::pair<Point2, double>> next;
    for (const auto& [end, heading] : ends) {
      for (const double turn : {-0.5, -0.2, 0.2, 0.5}) {
        const Point2 to{end.x + 10.0 * std::cos(heading + turn),
                        end.y + 10.0 * std::sin(heading + turn)};
        world.AddLane(id++, {end, to});
        next.emplace_back(to, heading + turn);
      }
    }
    ends = std::move(next);
  }
  EXPECT_EQ(FindInTime(world).count, kMostLanePaths);
}

TEST(LanePathsTest, AHundredThousandLanesAtOnePlaceTakeBoundedTime) {
  World world;
  for (int i = 0; i < 100'000; ++i) {
    world.AddLane(1, {{-1.0, 1e-5 * i}, {-1.0, 1e-5 * i}, {0.4, 1e-5 * i}, {0.8, 1e-5 * i}});
  }
  EXPECT_GE(FindInTime(world).count, 1);
}

TEST(LanePathsTest, LanesOfOnePointAndNoLanesGiveNoPaths) {
  World world;
  EXPECT_EQ(FindInTime(world).count, 0);
  world.AddLane(1, {{0.0, 0.0}});
  world.AddLane(2, {{0.0, 0.0}, {0.0, 0.0}});
  const LanePathInputs inputs = FindInTime(world);
  EXPECT_EQ(inputs.count, 0);
  for (const float value : inputs.values) EXPECT_EQ(value, 0.0F);
}

TEST(LanePathsTest, SpeedsOfAnySizeGiveFiniteNumbers) {
  for (const double speed : {3e38, -3e38}) {
    World world{.speed = speed};
    world.AddLane(1, Line({-20.0, 0.0}, {150.0, 0.0}))->set_speed_limit(1e300);
    v1::Agent* agent = world.AddOther(1, {20.0, 0.0}, {0.0, 0.0});
    agent->mutable_states(0)->set_velocity_x(3e38F);
    const LanePathInputs inputs = FindInTime(world);
    EXPECT_NEAR(At(inputs, 0, kLeaderSpeed), 10.0, 1e-5);
    EXPECT_NEAR(At(inputs, 0, kSpeedDifference), speed > 0.0 ? 0.0 : 20.0, 1e-5);
    EXPECT_NEAR(At(inputs, 0, kSpeedLimit), 100.0 / 15.0, 1e-5);
  }
}

}  // namespace
}  // namespace maneuver::scene::lane_paths_test
