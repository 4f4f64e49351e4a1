#include "model/data/nuscenes/expansion_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "model/scene/scenario_validation.h"
#include "tests/unit/model/data/nuscenes/nuscenes_fixture.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::expansion_map_test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// Ids of the fixture's lanes: lanes in the order of the file, then connectors.
constexpr int64_t kOne = 1, kTwo = 2, kThree = 3, kUp = 4, kLeft = 5, kBack = 6;

std::string Token(const std::string& name) { return NuScenesFixture::Token(name); }

class ExpansionMapTest : public testing::Test {
 protected:
  // Reads the map and keeps what is damaged.
  absl::StatusOr<ExpansionMap> Read() {
    WriteBytes(folder_ / "toy-town.json", map_.dump());
    damages_.clear();
    return ReadExpansionMap(
        folder_ / "toy-town.json",
        [&](const absl::Status& damage) {
          damages_.emplace_back(damage.message());
          return absl::OkStatus();
        },
        [](double) {});
  }
  std::vector<v1::MapFeature> Features(v1::MapFeatureType type) {
    std::vector<v1::MapFeature> features;
    const auto map = Read();
    EXPECT_TRUE(map.ok()) << map.status();
    if (!map.ok()) return features;
    for (const v1::MapFeature& feature : map->features) {
      if (feature.type() == type) features.push_back(feature);
    }
    return features;
  }
  v1::MapFeature Lane(int64_t id) {
    for (const v1::MapFeature& lane : Features(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE)) {
      if (lane.id() == id) return lane;
    }
    ADD_FAILURE() << "no lane " << id;
    return {};
  }

  json map_ = NuScenesFixture().map;
  std::vector<std::string> damages_;
  const TemporaryFolder folder_;
};

TEST_F(ExpansionMapTest, LanesAndConnectorsFollowTheirArclinePathsByMetres) {
  const v1::MapFeature one = Lane(kOne);
  ASSERT_EQ(one.x_size(), 101);  // two paths that meet at 60 m
  for (int i = 0; i <= 100; ++i) EXPECT_NEAR(one.x(i), i, 1e-9);
  const v1::MapFeature left = Lane(kLeft);
  ASSERT_EQ(left.x_size(), 22);  // 20.7 m
  EXPECT_NEAR(left.x(21), 110.0, 1e-9);
  EXPECT_NEAR(left.y(21), 15.0, 1e-9);
  for (int i = 0; i < 15; ++i) {  // on the circle about (100, 10)
    EXPECT_NEAR(std::hypot(left.x(i) - 100.0, left.y(i) - 10.0), 10.0, 1e-9);
  }
}

TEST_F(ExpansionMapTest, ReadsSuccessorsFromEitherLane) {
  EXPECT_THAT(Lane(kOne).successor_ids(), ElementsAre(kLeft));
  EXPECT_THAT(Lane(kLeft).successor_ids(), ElementsAre(kUp));  // "up" names its predecessor
  EXPECT_THAT(Lane(kUp).successor_ids(), ElementsAre(kBack));
  EXPECT_THAT(Lane(kBack).successor_ids(), ElementsAre(kOne));  // the lanes make a circle
  EXPECT_THAT(Lane(kTwo).successor_ids(), IsEmpty());
}

TEST_F(ExpansionMapTest, CountsLinksToMissingLanesAndReadsOn) {
  const auto map = Read();
  ASSERT_TRUE(map.ok());
  EXPECT_EQ(map->open_links, 1);  // from "one" to "gone"
  EXPECT_THAT(damages_, IsEmpty());
}

TEST_F(ExpansionMapTest, CountsLanesWithoutAPath) {
  map_["arcline_path_3"][Token("up")] = json::array();
  map_["arcline_path_3"].erase(Token("back"));
  const auto map = Read();
  ASSERT_TRUE(map.ok());
  EXPECT_EQ(map->pathless_lanes, 2);
  EXPECT_THAT(damages_, IsEmpty());
}

TEST_F(ExpansionMapTest, NeighborsShareADividerAndRunTheSameWay) {
  EXPECT_THAT(Lane(kOne).left_neighbor_ids(), ElementsAre(kTwo));
  EXPECT_THAT(Lane(kTwo).right_neighbor_ids(), ElementsAre(kOne));
  // "two" and "three" both have the nodes of the road divider on their left.
  EXPECT_THAT(Lane(kTwo).left_neighbor_ids(), IsEmpty());
  EXPECT_THAT(Lane(kThree).left_neighbor_ids(), IsEmpty());
  // One node is where lanes touch, no neighbourhood.
  map_["lane"][1]["right_lane_divider_segments"].erase(0);
  map_["lane"][1]["right_lane_divider_segments"].erase(0);
  EXPECT_THAT(Lane(kOne).left_neighbor_ids(), IsEmpty());
}

TEST_F(ExpansionMapTest, ReadsDividersCrossingsAndStopLines) {
  const auto lines = Features(v1::MAP_FEATURE_TYPE_ROAD_LINE);
  ASSERT_EQ(lines.size(), 2u);  // the divider without paint is left out
  EXPECT_THAT(lines[0].x(), ElementsAre(0.0, 50.0, 100.0));
  EXPECT_THAT(lines[0].y(), ElementsAre(1.75, 1.75, 1.75));
  EXPECT_THAT(lines[1].y(), ElementsAre(5.25, 5.25, 5.25));
  const auto crossings = Features(v1::MAP_FEATURE_TYPE_CROSSWALK);
  ASSERT_EQ(crossings.size(), 1u);
  EXPECT_THAT(crossings[0].x(), ElementsAre(70.0, 73.0, 73.0, 70.0));
  const auto stops = Features(v1::MAP_FEATURE_TYPE_STOP_LINE);
  ASSERT_EQ(stops.size(), 1u);
  EXPECT_THAT(stops[0].x(), ElementsAre(67.0, 68.0, 68.0, 67.0, 67.0));  // closed
}

TEST_F(ExpansionMapTest, RoadEdgesSurroundAllAreasTogetherAndTheirHoles) {
  double length = 0.0;
  for (const v1::MapFeature& edge : Features(v1::MAP_FEATURE_TYPE_ROAD_EDGE)) {
    for (int i = 1; i < edge.x_size(); ++i) {
      length += std::hypot(edge.x(i) - edge.x(i - 1), edge.y(i) - edge.y(i - 1));
      // The side that both areas share is none.
      EXPECT_FALSE(edge.x(i) == 60.0 && edge.x(i - 1) == 60.0);
    }
  }
  // 100 m by 11 m, and a hole of 2 m by two sides of the square root of 2.
  EXPECT_NEAR(length, 2.0 * (100.0 + 11.0) + 2.0 + 2.0 * std::sqrt(2.0), 1e-9);
}

TEST_F(ExpansionMapTest, NamesTheRowThatIsDamagedAndReadsTheOthers) {
  const json whole = map_;
  const auto damages = [&](const json& map) {
    map_ = map;
    EXPECT_TRUE(Read().ok());
    return damages_;
  };
  json map = whole;
  map["arcline_path_3"][Token("up")][0]["radius"] = -1;
  EXPECT_THAT(damages(map),
              ElementsAre(AllOf(HasSubstr("toy-town.json: arcline_path_3." + Token("up") + "[0]"),
                                HasSubstr("radius must be positive"))));
  map = whole;
  map["arcline_path_3"][Token("up")][0]["radius"] = 1e-310;  // its curvature is infinite
  EXPECT_THAT(damages(map), ElementsAre(HasSubstr("end_pose: is not where the segments end")));
  map = whole;
  map["arcline_path_3"][Token("up")][0]["end_pose"][0] = 111.0;
  EXPECT_THAT(damages(map)[0], HasSubstr("end_pose: is not where the segments end"));
  map = whole;
  map["arcline_path_3"][Token("up")][0]["segment_length"][1] = 1e15;
  EXPECT_THAT(damages(map)[0], HasSubstr("segment_length: must be 3 numbers"));
  map = whole;
  map["node"].erase(0);
  EXPECT_THAT(damages(map), ElementsAre(AllOf(HasSubstr("lane_divider '" + Token("divider")),
                                              HasSubstr("names a node that does not exist"))));
  map = whole;
  map["ped_crossing"][0]["polygon_token"] = "nowhere";
  EXPECT_THAT(damages(map), ElementsAre(AllOf(HasSubstr("ped_crossing '" + Token("zebra")),
                                              HasSubstr("polygon token 'nowhere'"))));
  map = whole;
  map["node"][2]["y"] = "high";
  EXPECT_THAT(damages(map)[0], HasSubstr("toy-town.json: node[2].y: must be a number"));
  map = whole;
  map["lane"].push_back(map["lane"][0]);
  EXPECT_THAT(damages(map), ElementsAre(HasSubstr("occurs twice")));
}

TEST_F(ExpansionMapTest, RefusesAPathBeyondTheLanesOfAnyCity) {
  const json five_kilometres = {{"start_pose", {0.0, 0.0, 0.0}},
                                {"end_pose", {5000.0, 0.0, 0.0}},
                                {"shape", "LSL"},
                                {"radius", 10.0},
                                {"segment_length", {0.0, 5000.0, 0.0}}};
  json paths = json::object();
  for (int i = 1000; i <= 2000; ++i) paths[std::to_string(i)] = json::array({five_kilometres});
  map_["arcline_path_3"] = paths;
  ASSERT_TRUE(Read().ok());
  EXPECT_THAT(damages_,
              ElementsAre(AllOf(HasSubstr("toy-town.json: arcline_path_3.2000[0].segment_length"),
                                HasSubstr("all lanes together longer"))));
}

TEST_F(ExpansionMapTest, RefusesAreasOfMorePointsThanAnyCity) {
  json& nodes = map_["polygon"][0]["exterior_node_tokens"];
  const json node = nodes[0];
  while (nodes.size() < 19'990) nodes.push_back(node);
  json row = map_["ped_crossing"][0];
  row["polygon_token"] = map_["polygon"][0]["token"];
  map_["ped_crossing"] = json::array();
  while (map_["ped_crossing"].size() < 501) map_["ped_crossing"].push_back(row);
  map_["drivable_area"][0]["polygon_tokens"] = std::vector<json>(3, row["polygon_token"]);
  ASSERT_TRUE(Read().ok());
  ASSERT_EQ(damages_.size(), 4u);
  EXPECT_THAT(damages_[0], AllOf(HasSubstr("toy-town.json: ped_crossing"),
                                 HasSubstr("more points than those of any city")));
  EXPECT_THAT(damages_[3], HasSubstr("toy-town.json: drivable_area"));
}

TEST_F(ExpansionMapTest, RefusesAFileThatIsNotAMapExpansion) {
  map_ = {{"version", "1.0"}, {"node", json::array()}};
  EXPECT_THAT(std::string(Read().status().message()), HasSubstr("no map expansion of nuScenes"));
  map_.erase("node");
  EXPECT_EQ(Read().status().code(), absl::StatusCode::kDataLoss);
}

// Replaces one value somewhere in `value` by another one, or removes it.
void Mutate(json* value, std::mt19937& random) {
  json* place = value;
  while (place->is_structured() && !place->empty() && random() % 8 != 0) {
    auto next = place->begin();
    std::advance(next, static_cast<std::ptrdiff_t>(random() % place->size()));
    if (random() % 40 == 0) {
      place->erase(next);
      return;
    }
    place = &*next;
  }
  const std::vector<json> others = {nullptr,
                                    -1,
                                    1e300,
                                    "text",
                                    "",
                                    true,
                                    json::array(),
                                    json::object(),
                                    18446744073709551615u,
                                    Token("one"),
                                    json::array({json::array()})};
  *place = others[random() % others.size()];
}

TEST_F(ExpansionMapTest, AnyDamagedMapIsRefusedOrGivesAValidMap) {
  std::mt19937 random(26);
  const json whole = map_;
  int damaged = 0;
  for (int i = 0; i < 400; ++i) {
    map_ = whole;
    for (unsigned k = 0; k <= random() % 3; ++k) Mutate(&map_, random);
    const auto map = Read();
    damaged += !map.ok() || !damages_.empty();
    if (!map.ok()) {
      EXPECT_THAT(std::string(map.status().message()), HasSubstr("toy-town.json"));
      continue;
    }
    scene::MapFeatures features;
    for (const v1::MapFeature& feature : map->features) *features.Add() = feature;
    EXPECT_THAT(scene::ValidateMap(features, {}), IsEmpty());
  }
  EXPECT_GT(damaged, 200);
}

}  // namespace
}  // namespace maneuver::data::expansion_map_test
