#include "model/scene/lane_graph.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>
#include <set>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include "model/scene/road_map.h"
#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::lane_graph_test {
namespace {

using testing::ElementsAre;

constexpr double kDegree = std::numbers::pi / 180.0;

v1::MapFeature* AddLane(v1::Scenario* scenario, int64_t id, std::initializer_list<Point2> points) {
  v1::MapFeature* lane = AddFeature(scenario, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, points);
  lane->set_id(id);
  return lane;
}

// Returns the ids of the lanes that follow the lane with index i.
std::vector<int64_t> SuccessorIds(const LaneGraph& graph, int i) {
  std::vector<int64_t> ids;
  for (const int next : graph.Successors(i)) ids.push_back(graph.lane(next).id);
  return ids;
}

// Returns the points of the lane with index i.
std::span<const LanePoint> PointsOf(const LaneGraph& graph, int i) {
  const Lane& lane = graph.lane(i);
  return {&graph.Start(lane), &graph.End(lane) + 1};
}

double Seconds(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

TEST(LaneGraphTest, PointsHaveArcLengthsAndHeadings) {
  v1::Scenario scenario;
  AddLane(&scenario, 7, {{1.0, 1.0}, {4.0, 5.0}, {4.0, 7.0}})->set_speed_limit(13.0);
  const RoadMap map = RoadMap::Over(scenario.map_features());
  const LaneGraph& graph = map.lanes();
  ASSERT_EQ(graph.size(), 1);
  const Lane& lane = graph.lane(0);
  EXPECT_EQ(lane.id, 7);
  EXPECT_EQ(lane.speed_limit, 13.0);
  EXPECT_EQ(graph.Length(lane), 7.0);
  const auto points = PointsOf(graph, 0);
  ASSERT_EQ(points.size(), 3u);
  EXPECT_EQ(points[1].distance, 5.0);
  EXPECT_DOUBLE_EQ(points[0].cosine, 0.6);
  EXPECT_DOUBLE_EQ(points[0].sine, 0.8);
  EXPECT_DOUBLE_EQ(points[1].sine, 1.0);
  EXPECT_DOUBLE_EQ(points[2].sine, 1.0);  // as the segment before it
}

TEST(LaneGraphTest, HoldsDrivingLanesAndStopSignsOnly) {
  v1::Scenario scenario;
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_BIKE_LANE, {{0, 0}, {9, 0}});
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_ROAD_EDGE, {{0, 0}, {9, 0}});
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_STOP_SIGN, {{3, 4}});
  AddLane(&scenario, 1, {{5, 5}});
  AddLane(&scenario, 2, {{5, 5}, {5, 5}, {5.0005, 5}});
  AddLane(&scenario, 3, {});
  AddLane(&scenario, 4, {{5, 5}, {6, 5}});
  // All points near the first, although the outermost are further apart.
  AddLane(&scenario, 5, {{5, 5}, {5.0009, 5}, {4.9991, 5}});
  AddLane(&scenario, 6, {{5, 5}, {5, 5.002}});
  const RoadMap map = RoadMap::Over(scenario.map_features());
  const LaneGraph& graph = map.lanes();
  ASSERT_EQ(graph.size(), 2);
  EXPECT_EQ(graph.lane(0).id, 4);
  EXPECT_EQ(graph.lane(1).id, 6);
  EXPECT_EQ(PointsOf(graph, 0).size(), 2u);
  ASSERT_EQ(graph.stop_signs().size(), 1u);
  EXPECT_EQ(graph.stop_signs()[0].y, 4.0);
}

TEST(LaneGraphTest, LeavesOutPointsThatRepeat) {
  v1::Scenario scenario;
  AddLane(&scenario, 1, {{0, 0}, {0, 0}, {2, 0}, {2.0004, 0}, {2.0008, 0}, {2, 3}, {2, 3}});
  AddLane(&scenario, 2, {{0, 0}, {2, 0}, {2, 3}});
  AddLane(&scenario, 3, {{0, 0}, {2, 0}, {2.0004, 0}, {2, 3}});
  const RoadMap map = RoadMap::Over(scenario.map_features());
  const LaneGraph& graph = map.lanes();
  for (const int i : {0, 2}) {
    const auto points = PointsOf(graph, i);
    const auto expected = PointsOf(graph, 1);
    ASSERT_EQ(points.size(), 3u);
    for (size_t p = 0; p < 3; ++p) {
      EXPECT_EQ(points[p].x, expected[p].x);
      EXPECT_EQ(points[p].y, expected[p].y);
      EXPECT_EQ(points[p].distance, expected[p].distance);
      EXPECT_EQ(points[p].cosine, expected[p].cosine);
    }
  }
}

// A repeated point at the end of a long lane does not affect the rest of it.
TEST(LaneGraphTest, LongLanesHaveTheSamePointsWithAndWithoutARepeatedOne) {
  v1::Scenario scenario;
  v1::MapFeature* once = AddLane(&scenario, 1, {});
  for (int i = 0; i < 300; ++i) {
    once->add_x(100.0 * std::cos(0.01 * i));
    once->add_y(70.0 * std::sin(0.01 * i));
  }
  v1::MapFeature* twice = scenario.add_map_features();
  *twice = *scenario.mutable_map_features(0);
  twice->add_x(twice->x(299));
  twice->add_y(twice->y(299));
  const RoadMap map = RoadMap::Over(scenario.map_features());
  const LaneGraph& graph = map.lanes();
  ASSERT_EQ(PointsOf(graph, 0).size(), 300u);
  ASSERT_EQ(PointsOf(graph, 1).size(), 300u);
  double length = 0.0;
  for (size_t i = 0; i < 300; ++i) {
    const LanePoint& a = PointsOf(graph, 0)[i];
    const LanePoint& b = PointsOf(graph, 1)[i];
    EXPECT_NEAR(a.distance, length, 1e-9);
    EXPECT_EQ(a.distance, b.distance);
    EXPECT_EQ(a.cosine, b.cosine);
    EXPECT_EQ(a.sine, b.sine);
    if (i < 299) {
      const LanePoint& next = PointsOf(graph, 0)[i + 1];
      EXPECT_NEAR(std::atan2(a.sine, a.cosine), std::atan2(next.y - a.y, next.x - a.x), 1e-12);
      length += std::hypot(next.x - a.x, next.y - a.y);
    }
  }
}

TEST(LaneGraphTest, ALaneFollowsIfItBeginsAtTheEndInTheSameDirection) {
  const auto follows = [](double x, double y, double heading) {
    v1::Scenario scenario;
    AddLane(&scenario, 1, {{0, 0}, {10, 0}});
    AddLane(&scenario, 2, {{x, y}, {x + 20 * std::cos(heading), y + 20 * std::sin(heading)}});
    return !SuccessorIds(RoadMap::Over(scenario.map_features()).lanes(), 0).empty();
  };
  EXPECT_TRUE(follows(10, 0, 0));
  EXPECT_TRUE(follows(10.59, 0, 0));
  EXPECT_TRUE(follows(9.41, 0, 0));
  EXPECT_TRUE(follows(10, -0.59, 0));
  EXPECT_FALSE(follows(10.61, 0, 0));
  EXPECT_FALSE(follows(10.5, 0.5, 0));  // 0.71 m away
  EXPECT_FALSE(follows(9.39, 0, 0));
  EXPECT_TRUE(follows(10, 0, 36.8 * kDegree));
  EXPECT_TRUE(follows(10, 0, -36.8 * kDegree));
  EXPECT_FALSE(follows(10, 0, 36.9 * kDegree));
  EXPECT_FALSE(follows(10, 0, std::numbers::pi));
}

// Adds lanes that are far from all others: so many that a graph no longer looks at each of them.
void AddFarLanes(v1::Scenario* scenario) {
  for (int i = 0; i < 600; ++i) AddLane(scenario, 1000 + i, {{500.0 + i, 300}, {500.5 + i, 300}});
}

// Anywhere in the world, so that starts and ends fall into neighbouring cells of the search.
TEST(LaneGraphTest, SuccessorsByGeometryMatchAFullSearch) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  size_t found = 0;
  for (int trial = 0; trial < 100; ++trial) {
    const bool few = trial % 2 == 0;
    v1::Scenario scenario;
    for (int id = 1; id <= 40; ++id) {
      const Point2 start{2.0 * uniform(random), 2.0 * uniform(random)};
      AddLane(&scenario, id, {start, {start.x + uniform(random), start.y + uniform(random)}});
    }
    if (!few) AddFarLanes(&scenario);
    const RoadMap map = RoadMap::Over(scenario.map_features());
    const LaneGraph& graph = map.lanes();
    for (int i = 0; i < 40; ++i) {
      const v1::MapFeature& lane = scenario.map_features(i);
      std::vector<int64_t> expected;
      for (const v1::MapFeature& next : scenario.map_features()) {
        const double turn = std::atan2(next.y(1) - next.y(0), next.x(1) - next.x(0)) -
                            std::atan2(lane.y(1) - lane.y(0), lane.x(1) - lane.x(0));
        if (next.id() != lane.id() && std::cos(turn) > 0.8 &&
            std::hypot(next.x(0) - lane.x(1), next.y(0) - lane.y(1)) < 0.6) {
          expected.push_back(next.id());
        }
      }
      EXPECT_EQ(SuccessorIds(graph, i), expected);
      found += expected.size();
    }
  }
  EXPECT_GT(found, 1000u);
}

// Of more lanes than are considered, the same ones count.
TEST(LaneGraphTest, SuccessorsInACrowdDoNotDependOnTheRestOfTheMap) {
  std::mt19937 random(6);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  constexpr int kCrowd = 4 * LaneGraph::kMostCandidates;
  v1::Scenario few;
  for (int id = 1; id <= kCrowd; ++id) {
    const Point2 start{7.3 + 0.5 * uniform(random), -2.4 + 0.5 * uniform(random)};
    AddLane(&few, id, {start, {start.x + uniform(random), start.y + uniform(random)}});
  }
  v1::Scenario many = few;
  AddFarLanes(&many);
  const RoadMap map = RoadMap::Over(few.map_features());
  const RoadMap larger = RoadMap::Over(many.map_features());
  size_t found = 0;
  for (int i = 0; i < kCrowd; ++i) {
    ASSERT_EQ(SuccessorIds(map.lanes(), i), SuccessorIds(larger.lanes(), i)) << i;
    found += map.lanes().Successors(i).size();
  }
  EXPECT_GT(found, 200u);
}

TEST(LaneGraphTest, DeclaredSuccessorsReplaceThoseByGeometry) {
  v1::Scenario scenario;
  v1::MapFeature* lane = AddLane(&scenario, 1, {{0, 0}, {10, 0}});
  AddLane(&scenario, 2, {{10, 0}, {20, 0}});
  AddLane(&scenario, 3, {{10, 2}, {10, 12}});
  AddLane(&scenario, 4, {{15.1, 0}, {30, 0}});
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_BIKE_LANE, {{10, 0}, {20, 0}})->set_id(5);
  EXPECT_THAT(SuccessorIds(RoadMap::Over(scenario.map_features()).lanes(), 0), ElementsAre(2));
  lane = scenario.mutable_map_features(0);
  // Lane 3 counts, at an angle that geometry would not accept. 4 begins too far away, 5 is no
  // driving lane, 6 does not exist, 0 is not an id, and no lane follows itself.
  for (const int64_t id : {6, 3, 5, 4, 0, 1, 3}) lane->add_successor_ids(id);
  EXPECT_THAT(SuccessorIds(RoadMap::Over(scenario.map_features()).lanes(), 0), ElementsAre(3));
  lane->clear_successor_ids();
  for (const int64_t id : {6, 5, 4, 0, 1}) lane->add_successor_ids(id);
  EXPECT_THAT(SuccessorIds(RoadMap::Over(scenario.map_features()).lanes(), 0), ElementsAre(2));
  // In the order of the declaration.
  lane->clear_successor_ids();
  for (const int64_t id : {3, 2}) lane->add_successor_ids(id);
  EXPECT_THAT(SuccessorIds(RoadMap::Over(scenario.map_features()).lanes(), 0), ElementsAre(3, 2));
}

TEST(LaneGraphTest, AnIdSharedByLanesNamesTheFirst) {
  v1::Scenario scenario;
  AddLane(&scenario, 1, {{0, 0}, {10, 0}})->add_successor_ids(2);
  AddLane(&scenario, 2, {{10, 1}, {20, 1}});
  AddLane(&scenario, 2, {{10, 0}, {20, 0}});
  const RoadMap map = RoadMap::Over(scenario.map_features());
  const LaneGraph& graph = map.lanes();
  const auto successors = graph.Successors(0);
  ASSERT_EQ(successors.size(), 1u);
  EXPECT_EQ(successors[0], 1);
}

TEST(LaneGraphTest, FindsEveryPieceNearAPoint) {
  std::mt19937 random(6);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (const int lanes : {1, 8, 9, 64, 65, 700}) {
    v1::Scenario scenario;
    for (int id = 1; id <= lanes; ++id) {
      v1::MapFeature* lane = AddLane(&scenario, id, {});
      double x = 200.0 * uniform(random);
      double y = 200.0 * uniform(random);
      for (int i = 0; i < 40; ++i) {
        lane->add_x(x += 2.0 * uniform(random));
        lane->add_y(y += 2.0 * uniform(random));
      }
    }
    const RoadMap map = RoadMap::Over(scenario.map_features());
    const LaneGraph& graph = map.lanes();
    ASSERT_EQ(graph.size(), lanes);
    int found = 0;
    for (int trial = 0; trial < 100; ++trial) {
      const Point2 place{220.0 * uniform(random), 220.0 * uniform(random)};
      std::set<const LanePiece*> pieces;
      graph.ForEachPieceNear(place, 10.0, [&](const LanePiece& piece) {
        EXPECT_TRUE(pieces.insert(&piece).second) << "the same piece twice";
      });
      for (int lane = 0; lane < lanes; ++lane) {
        ASSERT_EQ(graph.lane(lane).last_piece, graph.lane(lane).first_piece + 2);
        for (int i = 0; i < 3; ++i) {
          const LanePiece& piece = graph.pieces()[graph.lane(lane).first_piece + i];
          bool near = false;
          for (int p = piece.first; p <= piece.last; ++p) {
            const LanePoint& point = graph.points()[p];
            near |= std::abs(point.x - place.x) <= 10.0 && std::abs(point.y - place.y) <= 10.0;
          }
          if (near) {
            EXPECT_TRUE(pieces.contains(&piece));
          }
          found += near;
        }
      }
    }
    EXPECT_TRUE(found > 0 || lanes < 64);
  }
}

TEST(LaneGraphTest, PiecesCoverEachSegmentOnce) {
  v1::Scenario scenario;
  for (int points = 2; points <= 50; ++points) {
    v1::MapFeature* lane = AddLane(&scenario, points, {});
    for (int i = 0; i < points; ++i) {
      lane->add_x(i);
      lane->add_y(points);
    }
  }
  const RoadMap map = RoadMap::Over(scenario.map_features());
  const LaneGraph& graph = map.lanes();
  for (int i = 0; i < graph.size(); ++i) {
    const Lane& lane = graph.lane(i);
    int next = lane.first;
    for (int j = lane.first_piece; j <= lane.last_piece; ++j) {
      const LanePiece& piece = graph.pieces()[j];
      EXPECT_EQ(piece.lane, i);
      EXPECT_EQ(piece.first, next);
      EXPECT_LE(piece.last - piece.first, LaneGraph::kPieceSegments);
      next = piece.last;
    }
    EXPECT_EQ(next, lane.last);
  }
}

TEST(LaneGraphTest, AMapWithoutLanesHasNone) {
  const RoadMap map{MapFeatures()};
  const LaneGraph& graph = map.lanes();
  EXPECT_EQ(graph.size(), 0);
  graph.ForEachPieceNear({0, 0}, 1e9, [](const LanePiece&) { FAIL(); });
}

// The worst that a map of n points can do: all lanes in one place, each following all others.
TEST(LaneGraphTest, HostileMapsAreBoundedInTimeAndMemory) {
  constexpr int kLanes = 100'000;
  const auto same_place = [](v1::MapFeature* lane, int) {
    for (const double x : {0.0, 0.0, 0.3, 0.3}) lane->add_x(x);
    for (int i = 0; i < 4; ++i) lane->add_y(0.0);
  };
  const auto one_point = [](v1::MapFeature* lane, int i) {
    lane->add_x(i);
    lane->add_y(0.0);
  };
  const auto one_long_row = [](v1::MapFeature* lane, int i) {
    for (const double x : {1.0 * i, i + 1.0}) lane->add_x(x);
    for (int k = 0; k < 2; ++k) lane->add_y(0.0);
  };
  const auto across_the_world = [](v1::MapFeature* lane, int i) {
    for (const double x : {-1e8, 1e8}) lane->add_x(x);
    for (const double y : {-1e8 + i, 1e8 - i}) lane->add_y(y);
  };
  using Fill = std::function<void(v1::MapFeature*, int)>;
  for (const Fill& fill :
       {Fill(same_place), Fill(one_point), Fill(one_long_row), Fill(across_the_world)}) {
    for (const bool declares : {false, true}) {
      v1::Scenario scenario;
      for (int i = 0; i < kLanes; ++i) {
        v1::MapFeature* lane = AddLane(&scenario, 1 + i % 100, {});
        fill(lane, i);
        for (int k = 0; declares && k < 64; ++k) lane->add_successor_ids(1 + (i + k) % 100);
      }
      const double seconds = Seconds([&] {
        const RoadMap map = RoadMap::Over(scenario.map_features());
        const LaneGraph& graph = map.lanes();
        EXPECT_LE(graph.bytes(), LaneGraph::MostBytes(scenario.map_features()));
        for (int i = 0; i < graph.size(); ++i) {
          EXPECT_LE(graph.Successors(i).size(), size_t{LaneGraph::kMostSuccessors});
        }
      });
      // Hundreds of times the usual time; quadratic growth takes longer.
      EXPECT_LT(seconds, 20.0);
    }
  }
}

// Threads that find the paths of different targets read lanes and successors at the same time.
TEST(LaneGraphTest, ManyThreadsReadTheSameLanes) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  v1::Scenario scenario;
  for (int id = 1; id <= 200; ++id) {
    v1::MapFeature* lane = AddLane(&scenario, id, {});
    const double x = 2.0 * uniform(random);
    for (int i = 0; i < 20; ++i) {
      lane->add_x(x + 0.2 * i);
      lane->add_y(0.05 * uniform(random));
    }
    if (id % 2 == 0) lane->add_successor_ids(1 + id / 2);
  }
  // Returns all that the graph knows, lanes in the given order.
  const auto read = [](const LaneGraph& graph, bool backwards) {
    std::vector<std::vector<double>> lanes(static_cast<size_t>(graph.size()));
    for (int k = 0; k < graph.size(); ++k) {
      const int i = backwards ? graph.size() - 1 - k : k;
      std::vector<double>& lane = lanes[static_cast<size_t>(i)];
      for (const int next : graph.Successors(i)) lane.push_back(next);
      for (const LanePoint& point : PointsOf(graph, i)) {
        lane.insert(lane.end(), {point.x, point.y, point.distance, point.cosine, point.sine});
      }
    }
    return lanes;
  };
  const auto expected = read(RoadMap::Over(scenario.map_features()).lanes(), false);
  const RoadMap map = RoadMap::Over(scenario.map_features());
  std::vector<std::vector<std::vector<double>>> found(4);
  std::vector<std::thread> threads;
  for (size_t t = 0; t < found.size(); ++t) {
    threads.emplace_back([&, t] { found[t] = read(map.lanes(), t % 2 == 1); });
  }
  for (std::thread& thread : threads) thread.join();
  for (const auto& lanes : found) EXPECT_EQ(lanes, expected);
}

TEST(RoadMapTest, LanesAreBuiltOnceForAllThreads) {
  v1::Scenario scenario;
  AddLane(&scenario, 1, {{0, 0}, {10, 0}});
  RoadMap map = RoadMap::Over(scenario.map_features());
  std::vector<const LaneGraph*> seen(4, nullptr);
  std::vector<std::thread> threads;
  for (const LaneGraph*& graph : seen) {
    threads.emplace_back([&map, &graph] { graph = &map.lanes(); });
  }
  for (std::thread& thread : threads) thread.join();
  for (const LaneGraph* graph : seen) EXPECT_EQ(graph, seen[0]);
  EXPECT_EQ(seen[0]->size(), 1);
  const RoadMap moved = std::move(map);
  EXPECT_EQ(&moved.lanes(), seen[0]);
}

TEST(RoadMapTest, BytesCountTheLanesFromTheStart) {
  v1::Scenario scenario;
  v1::MapFeature* lane = AddLane(&scenario, 1, {});
  for (int i = 0; i < 1000; ++i) {
    lane->add_x(i);
    lane->add_y(0);
  }
  const RoadMap map(scenario.map_features());
  const int64_t before = map.bytes();
  EXPECT_GE(before, 16'000 + map.lanes().bytes());
  EXPECT_EQ(map.bytes(), before);
}

}  // namespace
}  // namespace maneuver::scene::lane_graph_test
