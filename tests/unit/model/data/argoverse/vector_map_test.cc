#include "model/data/argoverse/vector_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

#include "absl/strings/str_replace.h"
#include "model/scene/scenario_validation.h"
#include "tests/unit/model/data/argoverse/argoverse_fixture.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::vector_map_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class VectorMapTest : public testing::Test {
 protected:
  // Reads a map and keeps what is damaged.
  absl::StatusOr<VectorMap> Read(const std::string& xml) {
    WriteBytes(folder_ / "map.xml", xml);
    damages_.clear();
    return ReadVectorMap(folder_ / "map.xml", [&](const absl::Status& damage) {
      damages_.emplace_back(damage.message());
      return absl::OkStatus();
    });
  }
  // Reads the fixture with `from` replaced by `to`, and returns what is damaged.
  std::vector<std::string> Damages(const std::string& from, const std::string& to) {
    const auto map = Read(absl::StrReplaceAll(ArgoverseMap(), {{from, to}}));
    EXPECT_TRUE(map.ok()) << map.status();
    return damages_;
  }

  std::vector<std::string> damages_;
  const TemporaryFolder folder_;
};

TEST_F(VectorMapTest, WaysBecomeLanesUnderTheirIds) {
  const auto map = Read(ArgoverseMap());
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_THAT(damages_, IsEmpty());
  ASSERT_EQ(map->lanes.size(), 5u);
  for (size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(map->lanes[i].id(), static_cast<int64_t>(i) + 1);
    EXPECT_EQ(map->lanes[i].type(), v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  }
  EXPECT_THAT(map->lanes[3].x(), ElementsAre(50.0, 0.0));
  EXPECT_THAT(map->lanes[3].y(), ElementsAre(7.0, 7.0));
}

TEST_F(VectorMapTest, ReadsSuccessorsFromEitherLane) {
  const auto map = Read(ArgoverseMap());
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_THAT(map->lanes[0].successor_ids(), ElementsAre(2));  // lane 2 names its predecessor
  EXPECT_THAT(map->lanes[1].successor_ids(), ElementsAre(5));
  EXPECT_THAT(map->lanes[4].successor_ids(), ElementsAre(1));  // a circle
  EXPECT_EQ(map->open_links, 1);                               // from 2 to 99
}

TEST_F(VectorMapTest, NeighborsRunTheSameWay) {
  const auto map = Read(ArgoverseMap());
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_THAT(map->lanes[0].left_neighbor_ids(), ElementsAre(3));
  EXPECT_THAT(map->lanes[2].right_neighbor_ids(), ElementsAre(1));
  EXPECT_THAT(map->lanes[2].left_neighbor_ids(), IsEmpty());  // 4 comes towards it
  EXPECT_THAT(map->lanes[3].left_neighbor_ids(), IsEmpty());
}

TEST_F(VectorMapTest, NamesTheElementThatIsDamagedAndReadsTheOthers) {
  EXPECT_THAT(Damages("lane_id=\"1\"", "lane_id=\"one\""),
              ElementsAre("map.xml: way: lane_id 'one' is not a whole number"));
  EXPECT_THAT(Damages("lane_id=\"2\"", "lane_id=\"1\""),
              ElementsAre("map.xml: way 1: another way has this lane_id"));
  EXPECT_THAT(Damages("ref=\"8\"", "ref=\"88\""),
              ElementsAre("map.xml: way 5: nd ref '88' names no node"));
  EXPECT_THAT(Damages("<nd ref=\"8\" />", ""),
              ElementsAre("map.xml: way 5: has fewer than two nd"));
  EXPECT_THAT(Damages("v=\"99\"", "v=\"9 9\""),
              ElementsAre("map.xml: way 2: successor '9 9' is neither a lane nor None"));
  for (const char* wrong : {"nan", "inf", "1e300", "", "east"}) {
    EXPECT_THAT(Damages("x=\"5050\"", std::string("x=\"") + wrong + "\"")[0],
                HasSubstr("map.xml: node 8: x '" + std::string(wrong) + "' is not a coordinate"));
  }
}

TEST_F(VectorMapTest, RefusesAFileThatIsNotAVectorMap) {
  EXPECT_THAT(std::string(Read("<osm/>").status().message()), HasSubstr("it has no <way>"));
  EXPECT_THAT(std::string(Read("{}").status().message()), HasSubstr("map.xml: no XML"));
}

TEST_F(VectorMapTest, AnyTruncationOrChangedByteIsRefusedOrGivesAValidMap) {
  const std::string whole = ArgoverseMap();
  std::mt19937 random(26);
  for (int i = 0; i < 600; ++i) {
    std::string xml = whole;
    if (i % 2 == 0) {
      xml.resize(random() % whole.size());
    } else {
      for (int k = 0; k < 3; ++k) xml[random() % xml.size()] = static_cast<char>(random() % 128);
    }
    const auto map = Read(xml);
    if (!map.ok()) {
      EXPECT_THAT(std::string(map.status().message()), HasSubstr("map.xml: "));
      continue;
    }
    scene::MapFeatures lanes;
    for (const v1::MapFeature& feature : map->lanes) *lanes.Add() = feature;
    EXPECT_THAT(scene::ValidateMap(lanes, {}), IsEmpty());
  }
}

}  // namespace
}  // namespace maneuver::data::vector_map_test
