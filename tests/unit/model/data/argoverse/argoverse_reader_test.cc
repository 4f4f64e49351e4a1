#include "model/data/argoverse/argoverse_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cctype>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "absl/strings/str_replace.h"
#include "model/data/argoverse/vector_map.h"
#include "model/data/recording_split.h"
#include "model/data/stable_hash.h"
#include "model/scene/scenario_validation.h"
#include "tests/unit/model/data/argoverse/argoverse_fixture.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::argoverse_reader_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr char kFirstRow[] = "315969904.250000,av,AV,0.000000000,0.000000000,PIT";

v1::Scenario Parsed(const std::string& csv, const CityMaps* maps = nullptr) {
  const auto scenario = ParseArgoverse(csv, "12345", maps);
  EXPECT_TRUE(scenario.ok()) << scenario.status();
  return scenario.ok() ? *scenario : v1::Scenario();
}

v1::Agent AgentOf(const v1::Scenario& scenario, const std::string& track) {
  for (const v1::Agent& agent : scenario.agents()) {
    if (agent.id() == AgentId(track)) return agent;
  }
  ADD_FAILURE() << "no agent " << track;
  return {};
}

CityMaps Maps() {
  const TemporaryFolder folder;
  WriteBytes(folder / "map.xml", ArgoverseMap());
  auto map = ReadVectorMap(folder / "map.xml", [](const absl::Status& damage) { return damage; });
  EXPECT_TRUE(map.ok()) << map.status();
  CityMaps maps;
  if (map.ok()) maps.emplace("PIT", CityMap(std::move(map->lanes)));
  return maps;
}

TEST(ArgoverseReaderTest, TracksKeepTheirPositionsAndGetVelocitiesAndHeadings) {
  const v1::Scenario scenario = Parsed(ArgoverseSequence());
  EXPECT_THAT(scene::ValidateScenario(scenario, {}), IsEmpty());
  const v1::Agent agent = AgentOf(scenario, "agent");
  EXPECT_EQ(agent.type(), v1::AGENT_TYPE_VEHICLE);
  ASSERT_EQ(agent.states_size(), 50);
  for (int i = 0; i < 50; ++i) {
    const v1::AgentState& state = agent.states(i);
    const double t = 0.1 * i;
    EXPECT_NEAR(state.time(), t, 1e-6);
    EXPECT_NEAR(state.x(), 10.0 + 8.0 * t - 0.5 * t * t, 1e-6);
    if (i >= 10) {
      EXPECT_NEAR(state.velocity_x(), 8.0 - t, 1e-3);
    }
    EXPECT_NEAR(state.heading(), 0.0, 1e-3);
  }
}

TEST(ArgoverseReaderTest, TheAgentIsTheTargetAtTheTwentiethTime) {
  const v1::Scenario scenario = Parsed(ArgoverseSequence());
  EXPECT_THAT(scenario.target_ids(), ElementsAre(AgentId("agent")));
  EXPECT_NEAR(scenario.prediction_time(), 1.9, 1e-6);
  EXPECT_FALSE(scene::ValidateTarget(scenario, 0, 0.05));
}

TEST(ArgoverseReaderTest, OnlyAvAndAgentHaveAType) {
  const v1::Scenario scenario = Parsed(ArgoverseSequence());
  EXPECT_EQ(AgentOf(scenario, "av").type(), v1::AGENT_TYPE_VEHICLE);
  EXPECT_EQ(AgentOf(scenario, "parked").type(), v1::AGENT_TYPE_UNSPECIFIED);
  EXPECT_EQ(AgentOf(scenario, "short").states_size(), 10);
  EXPECT_NEAR(AgentOf(scenario, "short").states(0).heading(), std::numbers::pi / 2.0, 1e-3);
}

TEST(ArgoverseReaderTest, SequencesOfOneDriveArePartsOfOneRecording) {
  const double first = 600.0 * 1000.0;
  const auto id = [](double time) { return Parsed(ArgoverseSequence(time)).scenario_id(); };
  EXPECT_EQ(id(first), "PIT-1000#12345");
  EXPECT_EQ(WithoutPart(id(first)), WithoutPart(id(first + 590.0)));
  EXPECT_NE(WithoutPart(id(first)), WithoutPart(id(first + 610.0)));
}

TEST(ArgoverseReaderTest, ImportsTheMapAroundAvAndAgent) {
  const CityMaps maps = Maps();
  const v1::Scenario scenario = Parsed(ArgoverseSequence(), &maps);
  std::vector<int64_t> lanes;
  for (const v1::MapFeature& lane : scenario.map_features()) lanes.push_back(lane.id());
  EXPECT_THAT(lanes, ElementsAre(1, 2, 3, 4));  // 5 is kilometres away
  // An agent that never moves has the heading of its lane.
  EXPECT_NEAR(std::abs(AgentOf(scenario, "parked").states(0).heading()), std::numbers::pi, 1e-6);
  const auto elsewhere =
      ParseArgoverse(absl::StrReplaceAll(ArgoverseSequence(), {{",PIT", ",MIA"}}), "1", &maps);
  EXPECT_THAT(std::string(elsewhere.status().message()), HasSubstr("there is no map of 'MIA'"));
}

TEST(ArgoverseReaderTest, ASlowAgentKeepsItsHeading) {
  std::string csv = "TIMESTAMP,TRACK_ID,OBJECT_TYPE,X,Y,CITY_NAME\n";
  for (int i = 0; i < 40; ++i) {
    // North at 5 m/s for two seconds, then at rest but for noise.
    const double y = std::min(0.5 * i, 10.0);
    const double noise = i > 20 ? 0.02 * std::sin(9.0 * i) : 0.0;
    csv += std::to_string(0.1 * i) + ",a,AGENT," + std::to_string(noise) + "," + std::to_string(y) +
           ",MIA\r\n";
  }
  const v1::Scenario scenario = Parsed(csv);
  for (const v1::AgentState& state : scenario.agents(0).states()) {
    EXPECT_NEAR(state.heading(), std::numbers::pi / 2.0, 0.1) << state.time();
  }
}

TEST(ArgoverseReaderTest, NamesTheRowAndTheColumnThatAreWrong) {
  const auto problem = [](const std::string& from, const std::string& to) {
    return std::string(
        ParseArgoverse(absl::StrReplaceAll(ArgoverseSequence(), {{from, to}}), "1", nullptr)
            .status()
            .message());
  };
  const std::string row = kFirstRow;
  EXPECT_EQ(problem(row, "soon,av,AV,0,0,PIT"), "row 2: TIMESTAMP 'soon' is not a number");
  EXPECT_EQ(problem(row, "1,av,AV,,0,PIT"), "row 2: X '' is not a number");
  EXPECT_THAT(problem(row, "1,av,AV,nan,0,PIT"), HasSubstr("row 2: X 'nan' must lie within"));
  EXPECT_THAT(problem(row, "1,av,AV,0,1e300,PIT"), HasSubstr("row 2: Y '1e300' must lie within"));
  EXPECT_THAT(problem(row, "1e12,av,AV,0,0,PIT"), HasSubstr("row 2: TIMESTAMP"));
  EXPECT_EQ(problem(row, "1,,AV,0,0,PIT"), "row 2: TRACK_ID is empty");
  EXPECT_EQ(problem(row, "1,av,TRAM,0,0,PIT"),
            "row 2: OBJECT_TYPE 'TRAM' must be AV, AGENT or OTHERS");
  EXPECT_EQ(problem(row, "1,av,AV,0,0"), "row 2: CITY_NAME is missing: the row has 5 fields");
  EXPECT_EQ(problem(row, "1,av,AV,0,0,MIA"), "row 3: CITY_NAME 'PIT' differs from 'MIA' before");
  EXPECT_THAT(problem(row, row + "\n" + row), HasSubstr("TRACK_ID 'av' has two rows with one"));
  EXPECT_THAT(problem("AGENT", "OTHERS"), HasSubstr("one track must be the AGENT, not 0"));
  EXPECT_THAT(problem("OTHERS", "AGENT"), HasSubstr("one track must be the AGENT, not 3"));
  EXPECT_THAT(problem("TRACK_ID", "TRACK"), HasSubstr("lacks the column TRACK_ID"));
  EXPECT_THAT(std::string(ParseArgoverse("", "1", nullptr).status().message()),
              HasSubstr("lacks the column TIMESTAMP"));
}

TEST(ArgoverseReaderTest, RefusesATrackWithMoreRowsThanAScenarioMayHave) {
  std::string rows;
  for (int i = 0; i <= scene::ScenarioLimits().max_states_per_agent; ++i) {
    rows += std::to_string(1.0 + 1e-5 * i) + ",many,OTHERS,0,0,PIT\n";
  }
  const std::string row = kFirstRow;
  const auto parsed =
      ParseArgoverse(absl::StrReplaceAll(ArgoverseSequence(), {{row, rows + row}}), "1", nullptr);
  EXPECT_THAT(std::string(parsed.status().message()),
              HasSubstr("row 2002: track 'many' has more than 2000 rows"));
}

TEST(ArgoverseReaderTest, RefusesMoreTracksThanAScenarioMayHaveAgents) {
  std::string rows;
  for (int i = 0; i <= scene::ScenarioLimits().max_agents; ++i) {
    rows += "1.0,t" + std::to_string(i) + ",OTHERS,0,0,PIT\n";
  }
  const std::string row = kFirstRow;
  const auto parsed =
      ParseArgoverse(absl::StrReplaceAll(ArgoverseSequence(), {{row, rows + row}}), "1", nullptr);
  EXPECT_EQ(std::string(parsed.status().message()), "row 2002: more than 2000 tracks");
}

TEST(ArgoverseReaderTest, AnyTruncationOrChangedByteIsRefusedOrGivesAValidScenario) {
  const std::string whole = ArgoverseSequence();
  std::mt19937 random(26);
  int usable = 0;
  for (int i = 0; i < 600; ++i) {
    std::string csv = whole;
    if (i % 2 == 0) {
      csv.resize(random() % whole.size());
    } else {
      for (int k = 0; k < 2; ++k) {
        char& c = csv[random() % csv.size()];
        c = static_cast<char>(std::isdigit(c) ? '0' + random() % 10 : random() % 128);
      }
    }
    const auto scenario = ParseArgoverse(csv, "1", nullptr);
    if (!scenario.ok()) {
      EXPECT_FALSE(scenario.status().message().empty());
      continue;
    }
    ++usable;
    // A digit may have changed: what is left can be improbable, and validation then says so.
    for (const auto& violation : scene::ValidateScenario(*scenario, {})) {
      EXPECT_THAT(violation.field, HasSubstr("velocity"));
    }
  }
  EXPECT_GT(usable, 30);
}

}  // namespace
}  // namespace maneuver::data::argoverse_reader_test
