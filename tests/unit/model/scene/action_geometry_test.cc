#include "model/scene/action_geometry.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <span>
#include <vector>

#include "model/scene/inputs_version.h"
#include "model/scene/lane_paths.h"
#include "model/scene/road_map.h"
#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::action_geometry_test {
namespace {

constexpr double kArcLengths[] = {2.5, 5, 7.5, 10, 15, 20, 25, 30, 40, 50, 65, 80, 100};

std::vector<double> Waypoints(int count, double interval) {
  std::vector<double> times(count);
  for (int i = 0; i < count; ++i) times[i] = interval * (i + 1);
  return times;
}
const GeometryWaypoints kUsual = FindGeometryWaypoints(Waypoints(50, 0.1));

struct Point {
  double x, y;
};

// Returns an action that moves straight from the target at `speed` in `direction`.
ActionPoints Straight(double speed, double direction, Point start = {0, 0}) {
  ActionPoints action;
  for (int t = 0; t < kGeometryTimes; ++t) {
    for (const bool now : {true, false}) {
      const double time = kUsual.times[t] - (now ? 0.0 : kUsual.steps[t]);
      auto& point = now ? action.at[t] : action.before[t];
      point[0] = static_cast<float>(start.x + speed * time * std::cos(direction));
      point[1] = static_cast<float>(start.y + speed * time * std::sin(direction));
    }
  }
  return action;
}

// Adds a straight lane path. The target is `offset` metres to its left; its heading is `heading` to
// the left of the target's. Returns its numbers.
float* AddStraightPath(LanePathInputs& paths, double offset, double heading, double length = 100) {
  float* path = &paths.values[paths.count++ * kLanePathInputs];
  const Point foot = {offset * std::sin(heading), -offset * std::cos(heading)};
  for (int i = 0; i < 13; ++i) {
    const double scale = std::max(kArcLengths[i], 5.0);
    path[2 * i] = static_cast<float>((foot.x + kArcLengths[i] * std::cos(heading)) / scale);
    path[2 * i + 1] = static_cast<float>((foot.y + kArcLengths[i] * std::sin(heading)) / scale);
    path[26 + i] = static_cast<float>(std::cos(heading));
    path[39 + i] = static_cast<float>(std::sin(heading));
  }
  path[62] = static_cast<float>(offset);
  path[63] = static_cast<float>(std::sin(-heading));
  path[64] = static_cast<float>(std::cos(-heading));
  path[65] = static_cast<float>(length / 50);
  return path;
}

struct Numbers {
  std::vector<float> pairs;
  std::vector<float> actions;

  const float* pair(int action, int path) const {
    return &pairs[(action * kMostLanePaths + path) * kPairNumbers];
  }
  const float* action(int action) const { return &actions[action * kActionNumbers]; }
};

Numbers Describe(std::span<const ActionPoints> trajectories, const LanePathInputs& paths,
                 double speed = 0.0, const GeometryWaypoints& waypoints = kUsual,
                 int version = kLatestInputsVersion) {
  // Initially nonzero, so that every number must be written.
  Numbers numbers{std::vector<float>(trajectories.size() * kMostLanePaths * kPairNumbers, 7.0f),
                  std::vector<float>(trajectories.size() * kActionNumbers, 7.0f)};
  DescribeActions(trajectories, waypoints, paths, speed, version, numbers.pairs, numbers.actions);
  return numbers;
}

// Finds the foot with angles rather than by the formulas of action_geometry.cc.
Point PlainFoot(const float* path, int version) {
  const double start = std::atan2(-path[63], path[64]);
  if (version >= 2) {
    const double first = std::atan2(path[39], path[26]);
    const double mean = start + 0.5 * std::remainder(first - start, 2.0 * M_PI);
    return {5 * path[0] - 2.5 * std::cos(mean), 5 * path[1] - 2.5 * std::sin(mean)};
  }
  // One metre to the left of the path is its direction turned by a quarter turn. The target, at
  // (0, 0), is path[62] of these from the foot.
  return {path[62] * std::sin(start), -path[62] * std::cos(start)};
}

// Computes the same numbers in double precision, one point and one segment at a time.
Numbers DescribePlainly(std::span<const ActionPoints> trajectories, const LanePathInputs& paths,
                        double speed, const GeometryWaypoints& waypoints,
                        int version = kLatestInputsVersion) {
  Numbers numbers;
  for (const ActionPoints& action : trajectories) {
    double speeds[3];
    Point heads[3];
    for (int t = 0; t < 3; ++t) {
      const Point u = {(action.at[t][0] - action.before[t][0]) / waypoints.steps[t],
                       (action.at[t][1] - action.before[t][1]) / waypoints.steps[t]};
      speeds[t] = std::hypot(u.x, u.y);
      heads[t] = {1, 0};
      if (speeds[t] > 0.5) heads[t] = {u.x / speeds[t], u.y / speeds[t]};
    }
    for (int p = 0; p < kMostLanePaths; ++p) {
      std::vector<double> pair(kPairNumbers, 0.0);
      if (p < paths.count) {
        const float* path = &paths.values[p * kLanePathInputs];
        std::vector<Point> line = {PlainFoot(path, version)};
        std::vector<double> arcs = {0.0};
        for (int i = 0; i < 13; ++i) {
          const double scale = std::max(kArcLengths[i], 5.0);
          line.push_back({path[2 * i] * scale, path[2 * i + 1] * scale});
          arcs.push_back(kArcLengths[i]);
        }
        for (int t = 0; t < 3; ++t) {
          double distance = 1e30;
          double left = 0;
          double arc = 0;
          Point along = {1, 0};
          for (int i = 0; i < 13; ++i) {
            const double length = std::hypot(line[i + 1].x - line[i].x, line[i + 1].y - line[i].y);
            const Point e = {(line[i + 1].x - line[i].x) / length,
                             (line[i + 1].y - line[i].y) / length};
            const Point r = {action.at[t][0] - line[i].x, action.at[t][1] - line[i].y};
            double a = r.x * e.x + r.y * e.y;
            if (i > 0) a = std::max(a, 0.0);
            if (i < 12) a = std::min(a, length);
            const double d = std::hypot(r.x - a * e.x, r.y - a * e.y);
            if (d * d >= distance * distance * (1 - 1e-4) - 1e-5) continue;
            distance = d;
            left = -r.x * e.y + r.y * e.x;
            arc = arcs[i] + a;
            along = e;
          }
          pair[t] = std::clamp(left / 3, -2.0, 2.0);
          pair[3 + t] = std::exp(-distance);
          pair[6 + t] = along.x * heads[t].y - along.y * heads[t].x;
          if (path[69] > 0) {
            const double gap = 30 * path[70] + 10 * path[71] * waypoints.times[t] - arc;
            pair[12 + t] = std::clamp(gap / 10, -2.0, 3.0);
            pair[15] = 1;
          }
          if (path[81] > 0 && t != 1) {
            pair[t == 0 ? 16 : 17] = std::clamp((30 * path[82] - arc) / 10, -2.0, 2.0);
          }
          if (t == 2) {
            pair[9] = along.x * heads[t].x + along.y * heads[t].y;
            pair[10] = arc / 50;
            pair[11] = path[65] - arc / 50;
          }
        }
      }
      numbers.pairs.insert(numbers.pairs.end(), pair.begin(), pair.end());
    }
    for (const double number :
         {action.at[2][0] / 50.0, action.at[2][1] / 20.0, action.at[0][0] / 20.0,
          action.at[0][1] / 10.0, speeds[0] / 15, speeds[1] / 15, speeds[2] / 15, heads[1].x,
          heads[1].y, heads[2].x, heads[2].y, (speeds[2] - speed) / 10, std::exp(-speeds[2])}) {
      numbers.actions.push_back(static_cast<float>(number));
    }
  }
  return numbers;
}

// Curved paths with leaders and stop lines, and actions near them.
struct Problem {
  LanePathInputs paths;
  std::vector<ActionPoints> actions;
};
Problem RandomProblem(int actions, int paths, uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  Problem problem;
  for (int p = 0; p < paths; ++p) {
    const double heading = 0.8 * uniform(random);
    float* path = AddStraightPath(problem.paths, 3 * uniform(random), heading);
    const double along = p % 2 == 0 ? 0.0 : 5 * uniform(random);  // of the foot
    Point at = {path[62] * std::sin(heading) + along * std::cos(heading),
                -path[62] * std::cos(heading) + along * std::sin(heading)};
    double arc = 0;
    const double curvature = 0.02 * uniform(random);
    for (int i = 0; i < 13; ++i) {
      const double step = kArcLengths[i] - arc;
      const double direction = heading + curvature * (arc + 0.5 * step);
      at = {at.x + step * std::cos(direction), at.y + step * std::sin(direction)};
      arc = kArcLengths[i];
      path[2 * i] = static_cast<float>(at.x / std::max(arc, 5.0));
      path[2 * i + 1] = static_cast<float>(at.y / std::max(arc, 5.0));
      path[26 + i] = static_cast<float>(std::cos(heading + curvature * arc));
      path[39 + i] = static_cast<float>(std::sin(heading + curvature * arc));
    }
    path[69] = p % 2 == 0 ? 1.0f : 0.0f;
    path[70] = static_cast<float>(1 + uniform(random));
    path[71] = static_cast<float>(1 + uniform(random));
    path[81] = p % 3 == 0 ? 1.0f : 0.0f;
    path[82] = static_cast<float>(uniform(random));
  }
  for (int a = 0; a < actions; ++a) {
    ActionPoints action =
        Straight(8 + 8 * uniform(random), uniform(random), {uniform(random), uniform(random)});
    for (auto& point : action.at) point[1] += static_cast<float>(2 * uniform(random));
    problem.actions.push_back(action);
  }
  return problem;
}

TEST(GeometryWaypointsTest, LiesAtSharesOfTheHorizonAndHalfASecondBefore) {
  EXPECT_EQ(kUsual.at, (std::array<int, 3>{19, 34, 49}));
  EXPECT_EQ(kUsual.before, (std::array<int, 3>{14, 29, 44}));
  EXPECT_NEAR(kUsual.times[1], 3.5, 1e-9);
  for (const double step : kUsual.steps) EXPECT_NEAR(step, 0.5, 1e-9);
}

TEST(GeometryWaypointsTest, ScalesWithTheHorizonButKeepsTheHalfSecond) {
  const GeometryWaypoints three = FindGeometryWaypoints(Waypoints(30, 0.1));
  EXPECT_EQ(three.at, (std::array<int, 3>{11, 20, 29}));  // 1.2, 2.1 and 3 s
  EXPECT_EQ(three.before, (std::array<int, 3>{6, 15, 24}));
  const GeometryWaypoints eight = FindGeometryWaypoints(Waypoints(80, 0.1));
  EXPECT_EQ(eight.at, (std::array<int, 3>{31, 55, 79}));  // 3.2, 5.6 and 8 s
  EXPECT_EQ(eight.before, (std::array<int, 3>{26, 50, 74}));
}

TEST(GeometryWaypointsTest, TakesTheNearestOfWaypointsThatAreFarApart) {
  const GeometryWaypoints found = FindGeometryWaypoints(Waypoints(3, 1.0));
  EXPECT_EQ(found.at, (std::array<int, 3>{0, 1, 2}));  // for 1.2, 2.1 and 3 s
  EXPECT_EQ(found.before, (std::array<int, 3>{-1, 0, 1}));
  for (const double step : found.steps) EXPECT_NEAR(step, 1.0, 1e-9);
}

TEST(GeometryWaypointsTest, UsesTheOnlyWaypoint) {
  const GeometryWaypoints found = FindGeometryWaypoints(Waypoints(1, 0.3));
  EXPECT_EQ(found.at, (std::array<int, 3>{0, 0, 0}));
  EXPECT_EQ(found.before, (std::array<int, 3>{-1, -1, -1}));
  EXPECT_NEAR(found.steps[2], 0.3, 1e-9);
}

TEST(ActionGeometryTest, AnActionOnAPathHasNoOffsetAndItsDistanceAsArcLength) {
  LanePathInputs paths;
  AddStraightPath(paths, 0.0, 0.0, 90.0);
  const ActionPoints action = Straight(10.0, 0.0);
  const Numbers numbers = Describe({&action, 1}, paths, 8.0);
  const float* pair = numbers.pair(0, 0);
  for (int t = 0; t < 3; ++t) {
    EXPECT_NEAR(pair[t], 0.0, 1e-5);
    EXPECT_NEAR(pair[3 + t], 1.0, 1e-5);
    EXPECT_NEAR(pair[6 + t], 0.0, 1e-5);
  }
  EXPECT_NEAR(pair[9], 1.0, 1e-5);
  EXPECT_NEAR(pair[10], 1.0, 1e-5);  // 50 m
  EXPECT_NEAR(pair[11], 0.8, 1e-5);  // 40 m of 90 m
  for (int i = 12; i < kPairNumbers; ++i) EXPECT_EQ(pair[i], 0.0f) << i;
  const float* own = numbers.action(0);
  const double expected[] = {1, 0, 1, 0, 10.0 / 15, 10.0 / 15, 10.0 / 15, 1, 0, 1, 0, 0.2};
  for (int i = 0; i < 12; ++i) EXPECT_NEAR(own[i], expected[i], 1e-5) << i;
  EXPECT_NEAR(own[12], std::exp(-10.0), 1e-6);
}

TEST(ActionGeometryTest, LeftOfAPathIsPositive) {
  LanePathInputs paths;
  AddStraightPath(paths, 1.5, 0.3);
  const ActionPoints action = Straight(10.0, 0.3);
  EXPECT_NEAR(Describe({&action, 1}, paths).pair(0, 0)[2], 0.5, 1e-5);
  LanePathInputs left;
  AddStraightPath(left, -1.5, 0.3);
  const Numbers numbers = Describe({&action, 1}, left);
  EXPECT_NEAR(numbers.pair(0, 0)[2], -0.5, 1e-5);
  EXPECT_NEAR(numbers.pair(0, 0)[5], std::exp(-1.5), 1e-5);
}

TEST(ActionGeometryTest, ADirectionToTheLeftOfThePathHasAPositiveSine) {
  LanePathInputs paths;
  AddStraightPath(paths, 0.0, 0.1);
  const ActionPoints action = Straight(5.0, 0.3);
  const Numbers numbers = Describe({&action, 1}, paths);
  for (int t = 0; t < 3; ++t) EXPECT_NEAR(numbers.pair(0, 0)[6 + t], std::sin(0.2), 1e-5);
  EXPECT_NEAR(numbers.pair(0, 0)[9], std::cos(0.2), 1e-5);
}

// The foot is beside the target only where the lane is.
TEST(ActionGeometryTest, APathLeadsForwardWhereverItsFootIs) {
  for (const double along : {-4.5, -3.0, -2.5, -1.0, 0.0, 2.0, 4.5}) {
    for (const double offset : {0.0, 1.2, -2.0}) {
      for (const double heading : {0.0, 0.4, -0.9}) {
        LanePathInputs paths;
        float* path = AddStraightPath(paths, offset, heading);
        for (int i = 0; i < 13; ++i) {
          const double scale = std::max(kArcLengths[i], 5.0);
          path[2 * i] += static_cast<float>(along * std::cos(heading) / scale);
          path[2 * i + 1] += static_cast<float>(along * std::sin(heading) / scale);
        }
        const ActionPoints action = Straight(10.0, heading);
        const Numbers numbers = Describe({&action, 1}, paths);
        const float* pair = numbers.pair(0, 0);
        for (int t = 0; t < 3; ++t) {
          EXPECT_NEAR(pair[t], offset / 3, 1e-3) << along << " " << offset << " " << heading;
          EXPECT_NEAR(pair[6 + t], 0.0, 1e-3) << along << " " << offset << " " << heading;
        }
        EXPECT_NEAR(pair[9], 1.0, 1e-4) << along << " " << offset << " " << heading;
        EXPECT_NEAR(50 * pair[10], 50.0 - along, 0.02) << along << " " << offset << " " << heading;
      }
    }
  }
}

TEST(ActionGeometryTest, ALaneThatEndedBehindTheTargetContinuesForward) {
  v1::Scenario scenario;
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {{-40.0, -1.5}, {-3.0, -1.5}});
  const RoadMap map = RoadMap::Over(scenario.map_features());
  LanePathInputs paths;
  LanePathFinder().Find(scenario, map.lanes(), 0.0, 1, Pose2(), 10.0, {}, &paths);
  ASSERT_EQ(paths.count, 1);
  const ActionPoints action = Straight(10.0, 0.0);
  const Numbers numbers = Describe({&action, 1}, paths);
  EXPECT_NEAR(numbers.pair(0, 0)[2], 0.5, 1e-3);         // 1.5 m to the left of it
  EXPECT_NEAR(numbers.pair(0, 0)[9], 1.0, 1e-4);         // along it, not against it
  EXPECT_NEAR(50 * numbers.pair(0, 0)[10], 53.0, 0.02);  // 50 m ahead of the target
  // Version 1 puts the foot beside the target, so that the path begins backwards.
  EXPECT_NEAR(Describe({&action, 1}, paths, 0.0, kUsual, 1).pair(0, 0)[9], -1.0, 1e-4);
}

TEST(ActionGeometryTest, APathContinuesStraightBeyondBothEnds) {
  LanePathInputs paths;
  AddStraightPath(paths, 0.0, 0.0, 100.0);
  const std::vector<ActionPoints> actions = {Straight(30.0, 0.0), Straight(-4.0, 0.0)};
  const Numbers numbers = Describe(actions, paths);
  EXPECT_NEAR(numbers.pair(0, 0)[5], 1.0, 1e-4);
  EXPECT_NEAR(numbers.pair(0, 0)[10], 3.0, 1e-4);   // 150 m
  EXPECT_NEAR(numbers.pair(0, 0)[11], -1.0, 1e-4);  // 50 m past 100 m
  EXPECT_NEAR(numbers.pair(1, 0)[5], 1.0, 1e-4);
  EXPECT_NEAR(numbers.pair(1, 0)[10], -0.4, 1e-4);
  EXPECT_NEAR(numbers.pair(1, 0)[9], -1.0, 1e-4);
}

TEST(ActionGeometryTest, MeasuresLeaderAndStopLineFromTheActionsPosition) {
  LanePathInputs paths;
  float* path = AddStraightPath(paths, 0.0, 0.0);
  path[69] = 1.0f;
  path[70] = 0.5f;  // 15 m ahead
  path[71] = 0.8f;  // at 8 m/s
  path[81] = 1.0f;
  path[82] = 1.0f;  // 30 m ahead
  const ActionPoints action = Straight(10.0, 0.0);
  const Numbers numbers = Describe({&action, 1}, paths);
  const float* pair = numbers.pair(0, 0);
  EXPECT_NEAR(pair[12], 1.1, 1e-5);  // 15 + 16 - 20
  EXPECT_NEAR(pair[13], 0.8, 1e-5);  // 15 + 28 - 35
  EXPECT_NEAR(pair[14], 0.5, 1e-5);  // 15 + 40 - 50
  EXPECT_EQ(pair[15], 1.0f);
  EXPECT_NEAR(pair[16], 1.0, 1e-5);   // 30 - 20
  EXPECT_NEAR(pair[17], -2.0, 1e-5);  // 30 - 50
}

TEST(ActionGeometryTest, AStandingActionHeadsStraightAhead) {
  LanePathInputs paths;
  AddStraightPath(paths, 0.0, 0.2);
  const ActionPoints action = Straight(0.4, 2.0);
  const Numbers numbers = Describe({&action, 1}, paths);
  EXPECT_NEAR(numbers.pair(0, 0)[6], -std::sin(0.2), 1e-5);
  EXPECT_EQ(numbers.action(0)[9], 1.0f);
  EXPECT_EQ(numbers.action(0)[10], 0.0f);
}

// Every point of a wedge outside a bend is equally near to both segments.
TEST(ActionGeometryTest, RoundingDoesNotChooseTheSegmentBesideABend) {
  LanePathInputs paths;
  float* path = AddStraightPath(paths, 0.0, 0.0);
  for (int i = 7; i < 13; ++i) {  // turns left by 0.3 rad at 25 m
    const double further = kArcLengths[i] - 25.0;
    path[2 * i] = static_cast<float>((25.0 + further * std::cos(0.3)) / kArcLengths[i]);
    path[2 * i + 1] = static_cast<float>(further * std::sin(0.3) / kArcLengths[i]);
  }
  for (int i = 0; i < 1000; ++i) {
    ActionPoints action = Straight(5.0, 0.0);
    action.at[2] = {25.3f + 1e-5f * static_cast<float>(i), -4.0f};
    const Numbers numbers = Describe({&action, 1}, paths);
    EXPECT_NEAR(numbers.pair(0, 0)[2], -4.0 / 3, 1e-4) << i;  // of the first, which is straight on
    EXPECT_NEAR(numbers.pair(0, 0)[10], 0.5, 1e-6) << i;
  }
}

TEST(ActionGeometryTest, AbsentPathsAreZero) {
  const Problem problem = RandomProblem(3, 2, 5);
  const Numbers numbers = Describe(problem.actions, problem.paths);
  for (int a = 0; a < 3; ++a) {
    for (int p = 2; p < kMostLanePaths; ++p) {
      for (int i = 0; i < kPairNumbers; ++i) EXPECT_EQ(numbers.pair(a, p)[i], 0.0f);
    }
  }
}

TEST(ActionGeometryTest, EqualsAPlainEvaluation) {
  for (const int count : {1, 3, 6}) {
    const Problem problem = RandomProblem(70, count, 11 + count);
    for (const int version : {1, 2}) {
      const Numbers numbers = Describe(problem.actions, problem.paths, 7.0, kUsual, version);
      const Numbers plain = DescribePlainly(problem.actions, problem.paths, 7.0, kUsual, version);
      ASSERT_EQ(numbers.pairs.size(), plain.pairs.size());
      for (size_t i = 0; i < plain.pairs.size(); ++i) {
        ASSERT_NEAR(numbers.pairs[i], plain.pairs[i], 1e-4) << count << " " << i;
      }
      for (size_t i = 0; i < plain.actions.size(); ++i) {
        ASSERT_NEAR(numbers.actions[i], plain.actions[i], 1e-5) << i;
      }
    }
  }
}

TEST(ActionGeometryTest, AnActionHasTheSameBitsWhateverTheOthersAre) {
  const Problem problem = RandomProblem(70, 6, 3);
  const Numbers all = Describe(problem.actions, problem.paths, 4.0);
  for (int a = 0; a < 70; ++a) {
    const Numbers alone = Describe({&problem.actions[a], 1}, problem.paths, 4.0);
    EXPECT_TRUE(std::equal(alone.pairs.begin(), alone.pairs.end(), all.pair(a, 0))) << a;
    EXPECT_TRUE(std::equal(alone.actions.begin(), alone.actions.end(), all.action(a))) << a;
  }
}

TEST(ActionGeometryTest, AMirrorSwapsLeftAndRight) {
  Problem problem = RandomProblem(25, 6, 8);
  const Numbers numbers = Describe(problem.actions, problem.paths, 5.0);
  for (ActionPoints& action : problem.actions) {
    for (auto* points : {&action.at, &action.before}) {
      for (auto& point : *points) point[1] = -point[1];
    }
  }
  for (int p = 0; p < kMostLanePaths; ++p) {
    float* path = &problem.paths.values[p * kLanePathInputs];
    for (int i = 1; i < 26; i += 2) path[i] = -path[i];
    for (int i = 39; i < 52; ++i) path[i] = -path[i];
    path[62] = -path[62];
    path[63] = -path[63];
  }
  const Numbers mirrored = Describe(problem.actions, problem.paths, 5.0);
  for (int a = 0; a < 25; ++a) {
    for (int p = 0; p < kMostLanePaths; ++p) {
      for (int i = 0; i < kPairNumbers; ++i) {
        const bool swaps = i < 3 || (i >= 6 && i < 9);
        EXPECT_EQ(mirrored.pair(a, p)[i], (swaps ? -1 : 1) * numbers.pair(a, p)[i]) << i;
      }
    }
    for (int i = 0; i < kActionNumbers; ++i) {
      const bool swaps = i == 1 || i == 3 || i == 8 || i == 10;
      EXPECT_EQ(mirrored.action(a)[i], (swaps ? -1 : 1) * numbers.action(a)[i]) << i;
    }
  }
}

TEST(ActionGeometryTest, StaysFiniteIfAllPointsOfAPathCoincide) {
  LanePathInputs paths;
  paths.count = 1;
  paths.values[62] = 0.0f;
  const ActionPoints action = Straight(10.0, 0.5);
  const Numbers numbers = Describe({&action, 1}, paths);
  for (const float number : numbers.pairs) EXPECT_TRUE(std::isfinite(number));
  // The last segment continues along the target's heading.
  EXPECT_NEAR(numbers.pair(0, 0)[0], std::min(2.0, 20.0 * std::sin(0.5) / 3), 1e-5);
}

}  // namespace
}  // namespace maneuver::scene::action_geometry_test
