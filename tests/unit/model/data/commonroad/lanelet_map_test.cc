#include "model/data/commonroad/lanelet_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace maneuver::data::lanelet_map_test {
namespace {

// Returns a lanelet from x0 to x1 along the x axis, between y = right and y = left.
Lanelet Along(int64_t id, double x0, double x1, double right, double left) {
  Lanelet lanelet;
  lanelet.id = id;
  lanelet.left = {{x0, left}, {x1, left}};
  lanelet.right = {{x0, right}, {x1, right}};
  return lanelet;
}

std::vector<v1::MapFeature> OfType(const std::vector<v1::MapFeature>& features,
                                   v1::MapFeatureType type) {
  std::vector<v1::MapFeature> found;
  std::copy_if(features.begin(), features.end(), std::back_inserter(found),
               [type](const v1::MapFeature& feature) { return feature.type() == type; });
  return found;
}

// Returns the total length of lines, metres.
double Length(const std::vector<v1::MapFeature>& lines) {
  double length = 0.0;
  for (const v1::MapFeature& line : lines) {
    for (int i = 1; i < line.x_size(); ++i) {
      length += std::hypot(line.x(i) - line.x(i - 1), line.y(i) - line.y(i - 1));
    }
  }
  return length;
}

TEST(CenterlineTest, IsHalfwayBetweenTheBounds) {
  Lanelet lanelet = Along(1, 0.0, 10.0, -1.0, 3.0);
  EXPECT_DOUBLE_EQ(Centerline(lanelet)[1].y, 1.0);
  // If one side has fewer points, it is resampled by length: the corner is a third of the way along
  // the left bound.
  lanelet.left = {{0.0, 3.0}, {3.0, 3.0}, {9.0, 3.0}};
  const Polyline center = Centerline(lanelet);
  ASSERT_EQ(center.size(), 3u);
  EXPECT_DOUBLE_EQ(center[1].x, 0.5 * (4.5 + 5.0));
  EXPECT_DOUBLE_EQ(center[2].x, 9.5);
}

TEST(MapOfTest, TwoNeighboringLanesShareALineAndHaveEdgesOutside) {
  Lanelet right = Along(1, 0.0, 40.0, 0.0, 4.0);
  Lanelet left = Along(2, 0.0, 40.0, 4.0, 8.0);
  right.beside_left = 2;
  left.beside_right = 1;
  const auto features = MapOf({right, left});
  EXPECT_EQ(OfType(features, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE).size(), 2u);
  const auto lines = OfType(features, v1::MAP_FEATURE_TYPE_ROAD_LINE);
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_DOUBLE_EQ(lines[0].y(0), 4.0);
  const auto edges = OfType(features, v1::MAP_FEATURE_TYPE_ROAD_EDGE);
  ASSERT_EQ(edges.size(), 2u);
  EXPECT_EQ(edges[0].x_size(), 2);  // straight: its ends alone
  EXPECT_DOUBLE_EQ(Length(edges), 80.0);
}

TEST(MapOfTest, CenterlinesDeclareSuccessorsAndNeighborsInTheSameDirection) {
  Lanelet first = Along(1, 0.0, 40.0, 0.0, 4.0);
  Lanelet second = Along(2, 40.0, 80.0, 0.0, 4.0);
  Lanelet third = Along(3, 40.0, 80.0, 0.0, 4.0);
  first.successors = {2};
  second.predecessors = {1};
  third.predecessors = {1};
  first.beside_left = 7;  // the oncoming lanelet
  first.beside_right = 8;
  first.neighbor_right = 8;
  second.neighbor_left = 9;
  const auto lanes = OfType(MapOf({first, second, third}), v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  ASSERT_EQ(lanes.size(), 3u);
  EXPECT_THAT(lanes[0].successor_ids(), testing::ElementsAre(2, 3));
  EXPECT_THAT(lanes[1].successor_ids(), testing::IsEmpty());
  EXPECT_THAT(lanes[0].left_neighbor_ids(), testing::IsEmpty());
  EXPECT_THAT(lanes[0].right_neighbor_ids(), testing::ElementsAre(8));
  EXPECT_THAT(lanes[1].left_neighbor_ids(), testing::ElementsAre(9));
}

// Some files do not declare which lanelets lie side by side.
TEST(MapOfTest, NoEdgeRunsBetweenLanesThatTouchWithoutDeclaringIt) {
  const auto edges = OfType(MapOf({Along(1, 0.0, 40.0, 0.0, 4.0), Along(2, 0.0, 40.0, 4.0, 8.0)}),
                            v1::MAP_FEATURE_TYPE_ROAD_EDGE);
  ASSERT_EQ(edges.size(), 2u);
  EXPECT_DOUBLE_EQ(edges[0].y(0), 0.0);
  EXPECT_DOUBLE_EQ(edges[1].y(0), 8.0);
}

TEST(MapOfTest, ABoundThatIsAbsurdlyLongTakesABoundedTime) {
  for (const double end : {1e10, 1e34}) {
    const auto edges = OfType(MapOf({Along(1, 0, end, 0, 4)}), v1::MAP_FEATURE_TYPE_ROAD_EDGE);
    ASSERT_EQ(edges.size(), 2u) << end;
    EXPECT_NEAR(Length(edges) / end, 2.0, 1e-9) << end;
  }
}

// In pieces of 2 m, this would take 1e11 looks at a lanelet.
TEST(MapOfTest, ManyLongBoundsTakeABoundedTime) {
  std::vector<Lanelet> lanelets;
  for (int i = 0; i < 1'000; ++i) {
    lanelets.push_back(Along(i + 1, 0.0, 1e5, 10.0 * i, 10.0 * i + 4.0));
  }
  const auto edges = OfType(MapOf(lanelets), v1::MAP_FEATURE_TYPE_ROAD_EDGE);
  EXPECT_EQ(edges.size(), 2'000u);
}

// Two crossing roads, each 4 m wide. 4 m of each bound lie on the other road.
TEST(MapOfTest, NoEdgeRunsAcrossAJunction) {
  Lanelet north;
  north.id = 2;
  north.left = {{18.0, -20.0}, {18.0, 20.0}};
  north.right = {{22.0, -20.0}, {22.0, 20.0}};
  const auto edges =
      OfType(MapOf({Along(1, 0.0, 40.0, -2.0, 2.0), north}), v1::MAP_FEATURE_TYPE_ROAD_EDGE);
  EXPECT_EQ(edges.size(), 8u);
  EXPECT_NEAR(Length(edges), 4 * 36.0, 1e-9);
  for (const v1::MapFeature& edge : edges) {
    for (int i = 0; i < edge.x_size(); ++i) {
      EXPECT_FALSE(std::abs(edge.x(i) - 20.0) < 1.9 && std::abs(edge.y(i)) < 1.9);
    }
  }
}

// One is 8 km long: it touches so many squares of the grid that it is not entered in them.
TEST(MapOfTest, NoEdgeRunsAcrossAJunctionWithAVeryLongLanelet) {
  Lanelet north;
  north.id = 2;
  north.left = {{3'018.0, -20.0}, {3'018.0, 20.0}};
  north.right = {{3'022.0, -20.0}, {3'022.0, 20.0}};
  const auto edges =
      OfType(MapOf({Along(1, 0.0, 8'000.0, -2.0, 2.0), north}), v1::MAP_FEATURE_TYPE_ROAD_EDGE);
  EXPECT_EQ(edges.size(), 8u);
  EXPECT_NEAR(Length(edges), 2 * 7'996.0 + 2 * 36.0, 1e-6);
}

TEST(MapOfTest, ACrosswalkBecomesAnAreaAndABicycleLaneACenterline) {
  Lanelet crosswalk = Along(1, 0.0, 3.0, 0.0, 10.0);
  crosswalk.kind = Lanelet::Kind::kCrosswalk;
  Lanelet cycles = Along(2, 10.0, 30.0, 0.0, 2.0);
  cycles.kind = Lanelet::Kind::kBicycle;
  Lanelet walks = Along(3, 50.0, 60.0, 0.0, 2.0);
  walks.kind = Lanelet::Kind::kSidewalk;
  const auto features = MapOf({crosswalk, cycles, walks});
  ASSERT_EQ(OfType(features, v1::MAP_FEATURE_TYPE_CROSSWALK).size(), 1u);
  EXPECT_EQ(OfType(features, v1::MAP_FEATURE_TYPE_CROSSWALK)[0].x_size(), 4);
  EXPECT_EQ(OfType(features, v1::MAP_FEATURE_TYPE_BIKE_LANE).size(), 1u);
  EXPECT_TRUE(OfType(features, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE).empty());
}

}  // namespace
}  // namespace maneuver::data::lanelet_map_test
