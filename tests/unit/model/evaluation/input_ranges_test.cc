#include "model/evaluation/input_ranges.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace maneuver::evaluation::input_ranges_test {
namespace {

// Returns the names of the figures that lie outside.
std::vector<std::string> Outside(const StratumKeys& keys, const InputRanges& ranges) {
  std::vector<std::string> names;
  for (const InputFigure& figure : InputFigures()) {
    if (IsOutside(figure, keys, ranges)) names.emplace_back(figure.name);
  }
  return names;
}

TEST(InputRangesTest, AnInputIsOutsideOnlyBelowOrAboveAllOthers) {
  InputRanges ranges;
  Widen({.agents = 3, .speed = 2.5, .map_features = 10}, ranges);
  Widen({.agents = 9, .speed = 12.5, .map_features = 0}, ranges);
  Widen({.agents = 5, .speed = 4.0, .map_features = 4}, ranges);
  EXPECT_TRUE(Outside({.agents = 3, .speed = 12.5, .map_features = 0}, ranges).empty());
  EXPECT_TRUE(Outside({.agents = 9, .speed = 2.5, .map_features = 10}, ranges).empty());
  using Names = std::vector<std::string>;
  EXPECT_EQ(Outside({.agents = 3, .speed = 12.6, .map_features = 0}, ranges), Names({"speed"}));
  EXPECT_EQ(Outside({.agents = 2, .speed = 2.4, .map_features = 0}, ranges),
            Names({"speed", "agents"}));
  EXPECT_EQ(Outside({.agents = 10, .speed = 3.0, .map_features = 11}, ranges),
            Names({"agents", "map"}));
}

TEST(InputRangesTest, WithoutARangeNothingIsOutside) {
  EXPECT_TRUE(Outside({.agents = 1'000, .speed = 99.0}, {}).empty());
}

TEST(InputRangesTest, CountsTheMapFeaturesThatReachNearTheTarget) {
  v1::Scenario scenario;
  const auto add = [&scenario](double low_x, double high_x, double y) {
    v1::MapFeature& feature = *scenario.add_map_features();
    for (const double x : {low_x, high_x}) {
      feature.add_x(x);
      feature.add_y(y);
    }
  };
  add(149.0, 900.0, 200.0);  // begins 49 m ahead
  add(151.0, 900.0, 200.0);  // begins 51 m ahead
  add(-900.0, 900.0, 249.0);
  add(-900.0, 900.0, 251.0);
  scenario.add_map_features();  // has no points
  const auto map = scene::RoadMap::Over(scenario.map_features());
  EXPECT_EQ(MapFeaturesNear(map, scene::Pose2(100.0, 200.0, 1.0)), 2);
  EXPECT_EQ(MapFeaturesNear(map, scene::Pose2(5'000.0, 200.0, 1.0)), 0);
}

}  // namespace
}  // namespace maneuver::evaluation::input_ranges_test
