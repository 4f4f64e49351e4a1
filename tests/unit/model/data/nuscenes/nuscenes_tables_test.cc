#include "model/data/nuscenes/nuscenes_tables.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "model/data/recording_split.h"
#include "model/data/stable_hash.h"
#include "model/scene/scenario_validation.h"
#include "tests/unit/model/data/nuscenes/nuscenes_fixture.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::nuscenes_tables_test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

std::string Token(const std::string& name) { return NuScenesFixture::Token(name); }

class NuScenesTablesTest : public testing::Test {
 protected:
  absl::StatusOr<std::vector<NuScenesScene>> Read(const NuScenesFixture& fixture) {
    fixture.Write(folder_.path());
    damages_.clear();
    return ReadNuScenes(
        fixture.Tables(folder_.path()),
        [&](const absl::Status& damage) {
          damages_.emplace_back(damage.message());
          return absl::OkStatus();
        },
        [](double) {});
  }
  // Returns the scenario of the first scene, without a map.
  v1::Scenario First(const NuScenesFixture& fixture) {
    const auto scenes = Read(fixture);
    EXPECT_TRUE(scenes.ok()) << scenes.status();
    if (!scenes.ok()) return {};
    const auto scenario = ScenarioOf((*scenes)[0], nullptr);
    EXPECT_TRUE(scenario.ok()) << scenario.status();
    return scenario.ok() ? *scenario : v1::Scenario();
  }
  // Returns why the first scene cannot be used.
  std::string Damage(const NuScenesFixture& fixture) {
    const auto scenes = Read(fixture);
    EXPECT_TRUE(scenes.ok()) << scenes.status();
    return scenes.ok() ? std::string(ScenarioOf((*scenes)[0], nullptr).status().message()) : "";
  }

  std::vector<std::string> damages_;  // of rows that belong to no scene
  const TemporaryFolder folder_;
};

v1::Agent AgentOf(const v1::Scenario& scenario, const std::string& name) {
  for (const v1::Agent& agent : scenario.agents()) {
    if (agent.id() == AgentId(Token("scene-0001/" + name))) return agent;
  }
  ADD_FAILURE() << "no agent " << name;
  return {};
}

TEST_F(NuScenesTablesTest, AnnotationsBecomeTenFramesASecond) {
  const v1::Scenario scenario = First(NuScenesFixture());
  EXPECT_THAT(scene::ValidateScenario(scenario, {}), IsEmpty());
  const v1::Agent car = AgentOf(scenario, "car");
  EXPECT_EQ(car.type(), v1::AGENT_TYPE_VEHICLE);
  EXPECT_FLOAT_EQ(static_cast<float>(car.length()), 4.5F);
  EXPECT_FLOAT_EQ(static_cast<float>(car.width()), 1.9F);
  ASSERT_EQ(car.states_size(), 41);  // 4 s
  for (int i = 0; i < car.states_size(); ++i) {
    EXPECT_NEAR(car.states(i).time(), 0.1 * i, 1e-9);
    EXPECT_NEAR(car.states(i).x(), 1.0 * i, 1e-6);
    EXPECT_NEAR(car.states(i).velocity_x(), 10.0, 1e-5);
  }
  const v1::Agent turner = AgentOf(scenario, "turner");  // across 180 degrees
  for (int i = 0; i < turner.states_size(); ++i) {
    const double expected = (170.0 + 4.0 * i) * std::numbers::pi / 180.0;
    EXPECT_NEAR(std::remainder(turner.states(i).heading() - expected, 2 * std::numbers::pi), 0.0,
                1e-5);
  }
}

TEST_F(NuScenesTablesTest, CategoriesAndAttributesGiveTheType) {
  const v1::Scenario scenario = First(NuScenesFixture());
  EXPECT_EQ(AgentOf(scenario, "walker").type(), v1::AGENT_TYPE_PEDESTRIAN);
  EXPECT_EQ(AgentOf(scenario, "rider").type(), v1::AGENT_TYPE_CYCLIST);
  EXPECT_EQ(AgentOf(scenario, "bicycle").type(), v1::AGENT_TYPE_OTHER);
  EXPECT_EQ(scenario.agents_size(), 6);  // the barrier of one annotation has no velocity
}

TEST_F(NuScenesTablesTest, TheRecordingCarRunsByItsCentre) {
  const v1::Scenario scenario = First(NuScenesFixture());
  const v1::Agent& ego = scenario.agents(0);
  EXPECT_EQ(ego.id(), 0);
  ASSERT_EQ(ego.states_size(), 41);
  for (int i = 0; i < 41; ++i) {
    EXPECT_NEAR(ego.states(i).x(), 0.8 * i + 1.385, 1e-6);
    EXPECT_NEAR(ego.states(i).y(), 3.5, 1e-9);
    EXPECT_NEAR(ego.states(i).velocity_x(), 8.0, 1e-4);
  }
  EXPECT_NEAR(scenario.prediction_time(), 2.0, 1e-9);
}

TEST_F(NuScenesTablesTest, ScenesOfOneDriveArePartsOfOneRecording) {
  const auto scenes = Read(NuScenesFixture(3, 3));
  ASSERT_TRUE(scenes.ok()) << scenes.status();
  std::vector<std::string> ids;
  for (const NuScenesScene& scene : *scenes) {
    ids.push_back(ScenarioOf(scene, nullptr)->scenario_id());
  }
  EXPECT_THAT(ids, ElementsAre("n001-a#scene-0001", "n001-a#scene-0002", "n001-b#scene-0003"));
  EXPECT_EQ(WithoutPart(ids[0]), WithoutPart(ids[1]));
}

TEST_F(NuScenesTablesTest, ATrackWithAGapHasNoFramesInIt) {
  NuScenesFixture fixture;
  json& annotations = fixture.tables["sample_annotation"];
  for (auto row = annotations.begin(); row != annotations.end(); ++row) {
    if ((*row)["sample_token"] == Token("scene-0001/4") &&
        (*row)["instance_token"] == Token("scene-0001/car")) {
      annotations.erase(row);
      break;
    }
  }
  fixture.Row("instance", "scene-0001/car")["nbr_annotations"] = 8;
  const v1::Agent car = AgentOf(First(fixture), "car");
  EXPECT_EQ(car.states_size(), 32);
  for (const v1::AgentState& state : car.states()) {
    EXPECT_FALSE(state.time() > 1.51 && state.time() < 2.49) << state.time();
  }
}

TEST_F(NuScenesTablesTest, ARowThatIsWrongDamagesItsSceneAndIsNamed) {
  const std::string row = "sample_annotation.json[0]";
  const auto damage = [&](const char* field, const json& value) {
    NuScenesFixture fixture(2, 3);
    fixture.tables["sample_annotation"][0][field] = value;
    const std::string text = Damage(fixture);
    const auto scenes = Read(fixture);
    EXPECT_TRUE(ScenarioOf((*scenes)[1], nullptr).ok());  // the other scene is whole
    EXPECT_THAT(damages_, IsEmpty());
    return text;
  };
  EXPECT_THAT(damage("translation", {1.0, nullptr, 0.0}),
              HasSubstr(row + ".translation: must be 3 numbers"));
  EXPECT_THAT(damage("translation", {1e9, 0.0, 0.0}), HasSubstr(row + ".translation"));
  EXPECT_THAT(damage("size", {0.0, 4.0, 1.0}), HasSubstr(row + ".size: must be positive"));
  EXPECT_THAT(damage("rotation", {0.1, 0.0, 0.0, 0.0}), HasSubstr(row + ".rotation: must be a"));
  EXPECT_THAT(damage("rotation", "north"), HasSubstr(row + ".rotation"));
  EXPECT_THAT(damage("instance_token", "nobody"),
              HasSubstr(row + ".instance_token: names 'nobody', which is not in instance.json"));
  EXPECT_THAT(damage("attribute_tokens", json::array({"none"})),
              HasSubstr("names 'none', which is not in attribute.json"));
}

TEST_F(NuScenesTablesTest, ARowOfNoSceneIsNamedAndLeftOut) {
  NuScenesFixture fixture;
  json lost = fixture.tables["sample_annotation"][0];
  lost["sample_token"] = "nowhere";
  fixture.tables["sample_annotation"].push_back(lost);
  fixture.tables["sample"].push_back(3);
  EXPECT_THAT(Damage(fixture), IsEmpty());
  EXPECT_THAT(damages_, ElementsAre(HasSubstr("sample.json[9]: must be an object"),
                                    AllOf(HasSubstr(".sample_token: names 'nowhere'"),
                                          HasSubstr("which is not in sample.json"))));
}

TEST_F(NuScenesTablesTest, TokensThatPointNowhereAreNamed) {
  const auto damage = [&](const char* table, const char* field) {
    NuScenesFixture fixture;
    fixture.tables[table][0][field] = "nowhere";
    return Damage(fixture);
  };
  EXPECT_THAT(damage("scene", "log_token"),
              HasSubstr("scene.json[0].log_token: names 'nowhere', which is not in log.json"));
  EXPECT_THAT(damage("sample_data", "calibrated_sensor_token"),
              HasSubstr("which is not in calibrated_sensor.json"));
  EXPECT_THAT(damage("sample_data", "ego_pose_token"), HasSubstr("ego_pose.json lacks 'nowhere'"));
  EXPECT_THAT(damage("instance", "category_token"), HasSubstr("an instance without a category"));
  EXPECT_THAT(damages_, ElementsAre(HasSubstr("instance.json[0].category_token: names 'nowhere'")));
}

TEST_F(NuScenesTablesTest, MissingRowsAreNoticed) {
  NuScenesFixture fixture;
  fixture.tables["sample_annotation"].erase(0);
  EXPECT_THAT(Damage(fixture), HasSubstr("sample_annotation.json has 8 annotations of instance"));
  NuScenesFixture lost;
  auto& annotations = lost.tables["sample_annotation"];
  const json car = Token("scene-0001/car");
  annotations.erase(std::remove_if(annotations.begin(), annotations.end(),
                                   [&](const json& row) { return row["instance_token"] == car; }),
                    annotations.end());
  EXPECT_EQ(Damage(lost), "") << "the other instances are whole";
  EXPECT_THAT(damages_, ElementsAre(HasSubstr("json has 0 annotations of instance")));
  NuScenesFixture short_of_samples;
  short_of_samples.tables["sample"].erase(8);
  EXPECT_THAT(Damage(short_of_samples),
              HasSubstr("has 8 samples of it, where scene.json announces 9"));
  NuScenesFixture twice;
  twice.tables["sample"].push_back(twice.tables["sample"][3]);
  EXPECT_THAT(Damage(twice), HasSubstr("sample.json[9].token: is"));
  NuScenesFixture doubled;
  json again = doubled.tables["sample_annotation"][0];
  again["token"] = Token("again");
  doubled.tables["sample_annotation"].push_back(again);
  doubled.Row("instance", "scene-0001/car")["nbr_annotations"] = 10;
  EXPECT_THAT(Damage(doubled), HasSubstr("has two annotations in one sample"));
}

TEST_F(NuScenesTablesTest, NamesATableThatIsMissingOrTruncated) {
  const NuScenesFixture fixture;
  fixture.Write(folder_.path());
  const auto tables = fixture.Tables(folder_.path());
  EXPECT_TRUE(SizeOfNuScenes(tables).ok());
  std::filesystem::resize_file(tables / "sample_annotation.json", 999);
  const auto read = [&] {
    return ReadNuScenes(
        tables, [](const absl::Status&) { return absl::OkStatus(); }, [](double) {});
  };
  EXPECT_EQ(read().status().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(read().status().message()),
              HasSubstr("sample_annotation.json: no JSON at byte "));
  std::filesystem::remove(tables / "ego_pose.json");
  EXPECT_THAT(std::string(SizeOfNuScenes(tables).status().message()), HasSubstr("ego_pose.json"));
}

// Replaces values by others, somewhere in the tables.
TEST_F(NuScenesTablesTest, AnyDamagedTablesGiveValidScenariosOrAReason) {
  std::mt19937 random(26);
  const std::vector<json> others = {nullptr,
                                    -1,
                                    1e300,
                                    "text",
                                    "",
                                    true,
                                    json::array(),
                                    json::object(),
                                    18446744073709551615u,
                                    Token("scene-0001"),
                                    json::array({1, 2, 3}),
                                    int64_t{9'000'000'000'000'000'000}};
  int usable = 0, refused = 0;
  for (int i = 0; i < 150; ++i) {
    NuScenesFixture fixture(1, 3);
    for (unsigned k = 0; k <= random() % 2; ++k) {
      auto table = fixture.tables.begin();
      std::advance(table, static_cast<std::ptrdiff_t>(random() % fixture.tables.size()));
      if (random() % 20 == 0) {
        table->second = others[random() % others.size()];
        continue;
      }
      if (!table->second.is_array() || table->second.empty()) continue;
      json& row = table->second[random() % table->second.size()];
      if (!row.is_object() || row.empty()) continue;
      auto field = row.begin();
      std::advance(field, static_cast<std::ptrdiff_t>(random() % row.size()));
      *field = others[random() % others.size()];
    }
    const auto scenes = Read(fixture);
    if (!scenes.ok()) {
      EXPECT_THAT(std::string(scenes.status().message()), HasSubstr(".json"));
      ++refused;
      continue;
    }
    for (const NuScenesScene& scene : *scenes) {
      const auto scenario = ScenarioOf(scene, nullptr);
      refused += !scenario.ok();
      if (!scenario.ok()) {
        EXPECT_FALSE(scenario.status().message().empty());
        continue;
      }
      ++usable;
      EXPECT_THAT(scene::ValidateScenario(*scenario, {}), IsEmpty());
    }
  }
  EXPECT_GT(usable, 30);
  EXPECT_GT(refused, 10);
}

}  // namespace
}  // namespace maneuver::data::nuscenes_tables_test
