#include "model/data/town/synthetic_town.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "model/data/town/layouts.h"
#include "model/scene/scenario_validation.h"

namespace maneuver::data::town::synthetic_town_test {
namespace {

constexpr int kRecordings = 20;

// The recordings that several tests share, generated once.
const std::vector<TownRecording>& Recordings() {
  static const auto* const kGenerated = [] {
    auto* recordings = new std::vector<TownRecording>;
    for (int index = 0; index < kRecordings; ++index) {
      recordings->push_back(GenerateRecording({.seed = 7}, index));
    }
    return recordings;
  }();
  return *kGenerated;
}

std::string Bytes(const TownRecording& recording) {
  std::string bytes = recording.scenario.SerializeAsString();
  for (const v1::ManeuverAnnotation& annotation : recording.maneuvers) {
    bytes += annotation.SerializeAsString();
  }
  return bytes;
}

TEST(SyntheticTownTest, ARecordingDoesNotDependOnOthersThatWereGenerated) {
  const TownOptions options{.seed = 5};
  const std::string fourth = Bytes(GenerateRecording(options, 4));
  const std::string ninth = Bytes(GenerateRecording(options, 9));
  EXPECT_EQ(Bytes(GenerateRecording(options, 9)), ninth);
  EXPECT_EQ(Bytes(GenerateRecording(options, 4)), fourth);
  EXPECT_NE(fourth, ninth);
}

TEST(SyntheticTownTest, AnotherSeedGivesAnotherTown) {
  TownRecording a = GenerateRecording({.seed = 5}, 4);
  TownRecording b = GenerateRecording({.seed = 6}, 4);
  EXPECT_EQ(a.scenario.scenario_id(), "town-5-4");
  EXPECT_EQ(b.scenario.scenario_id(), "town-6-4");
  a.scenario.clear_scenario_id();
  b.scenario.clear_scenario_id();
  EXPECT_NE(a.scenario.SerializeAsString(), b.scenario.SerializeAsString());
}

TEST(SyntheticTownTest, EveryLayoutAppears) {
  std::map<std::string, int> layouts;
  for (int index = 0; index < 150; ++index) {
    Random random(7, static_cast<uint64_t>(index), 1);
    ++layouts[DrawPlace(random).layout];
  }
  EXPECT_EQ(layouts.size(), static_cast<size_t>(kLayoutCount));
}

TEST(SyntheticTownTest, DrawsTheGivenLayoutsAlone) {
  std::map<std::string, int> layouts;
  for (int index = 0; index < 60; ++index) {
    Random random(7, static_cast<uint64_t>(index), 1);
    ++layouts[DrawPlace(random, {"roundabout", "car_park"}).layout];
  }
  EXPECT_EQ(layouts.size(), 2u);
  EXPECT_GT(layouts["roundabout"], 10);
  EXPECT_GT(layouts["car_park"], 10);
  for (const std::string& name : LayoutNames()) {
    Random random(7, 1, 1);
    EXPECT_EQ(DrawPlace(random, {name}).layout, name);
  }
}

TEST(SyntheticTownTest, RecordingsAreValidScenarios) {
  for (int index = 0; index < kRecordings; ++index) {
    const v1::Scenario& scenario = Recordings()[index].scenario;
    const auto violations = scene::ValidateScenario(scenario, {});
    EXPECT_TRUE(violations.empty())
        << index << ": " << violations[0].field << " " << violations[0].description;
    for (int target = 0; target < scenario.target_ids_size(); ++target) {
      EXPECT_FALSE(scene::ValidateTarget(scenario, target, 0.05).has_value()) << index;
    }
  }
}

TEST(SyntheticTownTest, TheLongestRecordingIsAValidScenario) {
  const v1::Scenario scenario =
      GenerateRecording({.seed = 1, .duration = 199.9, .layouts = {"car_park"}}, 0).scenario;
  const auto violations = scene::ValidateScenario(scenario, {});
  EXPECT_TRUE(violations.empty()) << violations[0].field << " " << violations[0].description;
  int most = 0;
  for (const v1::Agent& agent : scenario.agents()) most = std::max(most, agent.states_size());
  EXPECT_EQ(most, scene::ScenarioLimits().max_states_per_agent);
}

TEST(SyntheticTownTest, ALongRecordingHasTrafficUntilItsEnd) {
  const v1::Scenario scenario =
      GenerateRecording({.seed = 1, .duration = 120.0, .layouts = {"motorway"}}, 0).scenario;
  double last = 0.0;
  for (const v1::Agent& agent : scenario.agents()) {
    last = std::max(last, agent.states().rbegin()->time());
  }
  EXPECT_GT(last, 110.0);
}

TEST(SyntheticTownTest, RecordingsAreAsLargeAsRealOnes) {
  for (int index = 0; index < kRecordings; ++index) {
    const v1::Scenario& scenario = Recordings()[index].scenario;
    EXPECT_GE(scenario.agents_size(), 15) << index;
    EXPECT_LE(scenario.agents_size(), 45) << index;
    int points = 0;
    for (const v1::MapFeature& feature : scenario.map_features()) {
      points += feature.x_size();
      for (int i = 1; i < feature.x_size(); ++i) {
        if (feature.type() != v1::MAP_FEATURE_TYPE_LANE_CENTERLINE) continue;
        ASSERT_LT(std::hypot(feature.x(i) - feature.x(i - 1), feature.y(i) - feature.y(i - 1)),
                  5.0);
      }
    }
    EXPECT_GE(points, 200) << index;
    EXPECT_LE(points, 5000) << index;
  }
}

TEST(SyntheticTownTest, EveryKindOfRoadUserAndMapFeatureOccurs) {
  std::set<int> agents;
  std::set<int> features;
  int signals = 0;
  for (int index = 0; index < kRecordings; ++index) {
    const v1::Scenario& scenario = Recordings()[index].scenario;
    for (const v1::Agent& agent : scenario.agents()) agents.insert(agent.type());
    for (const v1::MapFeature& feature : scenario.map_features()) features.insert(feature.type());
    signals += scenario.traffic_signals_size();
  }
  EXPECT_EQ(agents.size(), 3u);
  EXPECT_EQ(features.size(), 9u);
  EXPECT_GT(signals, 20);
}

TEST(SyntheticTownTest, SignalsControlLanesOnTheMap) {
  for (int index = 0; index < kRecordings; ++index) {
    const v1::Scenario& scenario = Recordings()[index].scenario;
    std::set<int64_t> lanes;
    for (const v1::MapFeature& feature : scenario.map_features()) lanes.insert(feature.id());
    for (const v1::TrafficSignal& signal : scenario.traffic_signals()) {
      EXPECT_TRUE(lanes.contains(signal.lane_id()));
      ASSERT_GT(signal.readings_size(), 0);
      EXPECT_EQ(signal.readings(0).time(), 0.0);
    }
  }
}

TEST(SyntheticTownTest, LanesDeclareSuccessorsThatBeginAtTheirEndsAndNeighborsBesideThem) {
  int successors = 0;
  int neighbors = 0;
  for (int index = 0; index < kRecordings; ++index) {
    const v1::Scenario& scenario = Recordings()[index].scenario;
    std::map<int64_t, const v1::MapFeature*> lanes;
    for (const v1::MapFeature& feature : scenario.map_features()) lanes[feature.id()] = &feature;
    for (const auto& [id, lane] : lanes) {
      const int last = lane->x_size() - 1;
      for (const int64_t next : lane->successor_ids()) {
        ASSERT_TRUE(lanes.contains(next));
        EXPECT_NEAR(lanes[next]->x(0), lane->x(last), 0.05);
        EXPECT_NEAR(lanes[next]->y(0), lane->y(last), 0.05);
        ++successors;
      }
      // A lane to the left has this one on its right, unless changing back is not allowed.
      for (const int64_t left : lane->left_neighbor_ids()) {
        ASSERT_TRUE(lanes.contains(left));
        const double dx = lane->x(1) - lane->x(0);
        const double dy = lane->y(1) - lane->y(0);
        double offset = 1e9;
        for (int i = 0; i < lanes[left]->x_size(); ++i) {
          const double x = lanes[left]->x(i) - lane->x(0);
          const double y = lanes[left]->y(i) - lane->y(0);
          if (std::hypot(x, y) < std::abs(offset)) {
            offset = std::copysign(std::hypot(x, y), dx * y - dy * x);
          }
        }
        EXPECT_GT(offset, 2.0);
        EXPECT_LT(offset, 8.0);
        ++neighbors;
      }
    }
  }
  EXPECT_GT(successors, 100);
  EXPECT_GT(neighbors, 10);
}

TEST(SyntheticTownTest, TargetsHaveAPastAndMoveAfterwards) {
  int targets = 0;
  int whole_future = 0;
  for (int index = 0; index < kRecordings; ++index) {
    const v1::Scenario& scenario = Recordings()[index].scenario;
    EXPECT_GE(scenario.prediction_time(), 1.0);
    EXPECT_LE(scenario.prediction_time(), 12.0 + 1e-6);
    EXPECT_GE(scenario.target_ids_size(), 1) << index;
    for (const int64_t id : scenario.target_ids()) {
      for (const v1::Agent& agent : scenario.agents()) {
        if (agent.id() != id) continue;
        EXPECT_EQ(agent.type(), v1::AGENT_TYPE_VEHICLE);
        EXPECT_LE(agent.states(0).time(), scenario.prediction_time() - 1.0 + 1e-6);
        const double end = agent.states(agent.states_size() - 1).time();
        EXPECT_GT(end, scenario.prediction_time());
        ++targets;
        if (end >= scenario.prediction_time() + 8.0 - 1e-6) ++whole_future;
      }
    }
  }
  EXPECT_GT(whole_future, targets / 2);
}

TEST(SyntheticTownTest, ManeuversCoverTheWholeTrackOfAVehicle) {
  for (int index = 0; index < kRecordings; ++index) {
    const TownRecording& recording = Recordings()[index];
    for (const v1::Agent& agent : recording.scenario.agents()) {
      if (agent.type() != v1::AGENT_TYPE_VEHICLE) continue;
      double reached = agent.states(0).time();
      for (const v1::ManeuverAnnotation& annotation : recording.maneuvers) {
        if (annotation.agent_id() != agent.id()) continue;
        EXPECT_EQ(annotation.scenario_id(), recording.scenario.scenario_id());
        EXPECT_NEAR(annotation.start_time(), reached, 1e-6) << index << " " << agent.id();
        EXPECT_GT(annotation.end_time(), annotation.start_time());
        reached = annotation.end_time();
      }
      EXPECT_NEAR(reached, agent.states(agent.states_size() - 1).time(), 1e-6);
    }
  }
}

TEST(SyntheticTownTest, HasTheRequestedFrameIntervalAndDuration) {
  const TownOptions options{.seed = 7, .duration = 9.0, .frame_interval = 0.25};
  const v1::Scenario scenario = GenerateRecording(options, 3).scenario;
  double last = 0.0;
  for (const v1::Agent& agent : scenario.agents()) {
    for (const v1::AgentState& state : agent.states()) {
      const double frames = state.time() / options.frame_interval;
      EXPECT_NEAR(frames, std::round(frames), 1e-6);
      last = std::max(last, state.time());
    }
  }
  EXPECT_NEAR(last, 9.0, 1e-6);
}

}  // namespace
}  // namespace maneuver::data::town::synthetic_town_test
