// Reads NGSIM's recordings in CommonRoad format, if they are available: MANEUVER_REAL_DATA names a
// folder that contains ngsim_commonroad/.

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "model/data/commonroad/commonroad_reader.h"
#include "model/scene/scenario_validation.h"

namespace maneuver::data::real_commonroad_test {
namespace {

int64_t Count(const std::string& text, const std::string& what) {
  int64_t count = 0;
  for (size_t at = text.find(what); at != text.npos; at = text.find(what, at + 1)) ++count;
  return count;
}

TEST(RealCommonRoadTest, EveryFileGivesAValidScenarioWithAllObstaclesAndLanelets) {
  const char* data = std::getenv("MANEUVER_REAL_DATA");
  const std::filesystem::path folder = std::filesystem::path(data ? data : "") / "ngsim_commonroad";
  if (data == nullptr || !std::filesystem::is_directory(folder)) {
    GTEST_SKIP() << "MANEUVER_REAL_DATA names no folder with ngsim_commonroad";
  }
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".xml") continue;
    SCOPED_TRACE(entry.path().filename());
    std::ifstream in(entry.path());
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    const auto scenario = ParseCommonRoad(text);
    ASSERT_TRUE(scenario.ok()) << scenario.status();
    const auto violations = scene::ValidateScenario(*scenario, scene::ScenarioLimits());
    ASSERT_TRUE(violations.empty()) << violations[0].field << ": " << violations[0].description;
    // Counted in the text, without a parser.
    EXPECT_EQ(scenario->agents_size(),
              Count(text, "<obstacle id=") + Count(text, "<dynamicObstacle id="));
    int64_t states = 0;
    for (const v1::Agent& agent : scenario->agents()) states += agent.states_size();
    EXPECT_EQ(states, scenario->agents_size() + Count(text, "<state>"));
    int64_t lanes = 0;
    int64_t successors = 0;
    for (const v1::MapFeature& feature : scenario->map_features()) {
      lanes += feature.type() == v1::MAP_FEATURE_TYPE_LANE_CENTERLINE;
      successors += feature.successor_ids_size();
    }
    EXPECT_EQ(lanes, Count(text, "<lanelet id="));
    EXPECT_EQ(successors, Count(text, "<successor ref="));
    ++files;
  }
  EXPECT_GT(files, 0);
}

}  // namespace
}  // namespace maneuver::data::real_commonroad_test
