#include "model/data/town/lane_network.h"

#include <numbers>

#include "gtest/gtest.h"

namespace maneuver::data::town::lane_network_test {
namespace {

Lane Straight(Vec2 from, double heading, double length) {
  Lane lane;
  lane.path = PathPen({.p = from, .heading = heading}).Straight(length).Done();
  return lane;
}

TEST(LaneNetworkTest, CrossingLanesConflictWhereTheyCross) {
  LaneNetwork graph;
  Lane gated = Straight({-20.0, 0.0}, 0.0, 40.0);
  gated.gate = Gate{.kind = GateKind::kYield};
  const int mine = graph.Add(gated);
  const int other = graph.Add(Straight({5.0, -30.0}, 0.5 * std::numbers::pi, 60.0));
  graph.FindConflicts();
  ASSERT_EQ(graph.lanes[mine].gate->conflicts.size(), 1u);
  const Conflict& conflict = graph.lanes[mine].gate->conflicts[0];
  EXPECT_EQ(conflict.lane, other);
  EXPECT_FALSE(conflict.merge);
  EXPECT_LT(conflict.from, 25.0);
  EXPECT_GT(conflict.to, 25.0);
  EXPECT_LT(conflict.lane_from, 30.0);
  EXPECT_GT(conflict.lane_to, 30.0);
  EXPECT_LT(conflict.to - conflict.from, 8.0);
}

TEST(LaneNetworkTest, LanesSideBySideDoNotConflict) {
  LaneNetwork graph;
  Lane gated = Straight({-20.0, 0.0}, 0.0, 40.0);
  gated.gate = Gate{.kind = GateKind::kYield};
  graph.Add(gated);
  graph.Add(Straight({-20.0, 3.5}, 0.0, 40.0));
  graph.FindConflicts();
  EXPECT_TRUE(graph.lanes[0].gate->conflicts.empty());
}

TEST(LaneNetworkTest, LanesIntoOneLaneMergeAndLanesOutOfOneLaneDoNotConflict) {
  LaneNetwork graph;
  const int in = graph.Add(Straight({-40.0, 0.0}, 0.0, 20.0));
  Lane a = Straight({-20.0, 0.0}, 0.0, 20.0);
  a.gate = Gate{.kind = GateKind::kYield};
  const int ahead = graph.Add(a);
  Lane b = Straight({-20.0, 0.0}, 0.2, 20.0);
  const int sibling = graph.Add(b);
  Lane c;
  c.path =
      ConnectPoses({.p = {-12.0, -12.0}, .heading = 0.5 * std::numbers::pi}, {.p = {0.0, 0.0}});
  const int joining = graph.Add(c);
  const int out = graph.Add(Straight({0.0, 0.0}, 0.0, 20.0));
  graph.lanes[in].next = {{.lane = ahead}, {.lane = sibling}};
  graph.lanes[ahead].next = {{.lane = out}};
  graph.lanes[joining].next = {{.lane = out}};
  graph.FindConflicts();
  ASSERT_EQ(graph.lanes[ahead].gate->conflicts.size(), 1u);
  EXPECT_EQ(graph.lanes[ahead].gate->conflicts[0].lane, joining);
  EXPECT_TRUE(graph.lanes[ahead].gate->conflicts[0].merge);
}

}  // namespace
}  // namespace maneuver::data::town::lane_network_test
