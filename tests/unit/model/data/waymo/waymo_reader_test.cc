#include "model/data/waymo/waymo_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "model/scene/scenario_validation.h"
#include "tests/unit/model/data/wire_format.h"

namespace maneuver::data::waymo_reader_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::MatchesRegex;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// Field numbers are those of waymo.open_dataset.Scenario, repeated here on purpose.
Wire State(double x, double y, double length = 4.5, double width = 2.0) {
  return Wire()
      .Double(2, x)
      .Double(3, y)
      .Double(4, 99.0)  // z
      .Float(5, static_cast<float>(length))
      .Float(6, static_cast<float>(width))
      .Float(7, 1.5f)  // height
      .Float(8, 0.25f)
      .Float(9, 3.0f)
      .Float(10, -4.0f)
      .Varint(11, 1);
}

Wire NoState() { return Wire().Double(2, -1.0).Double(3, -1.0).Varint(11, 0); }

Wire Track(int id, int type, const std::vector<Wire>& states) {
  Wire track = Wire().Varint(1, id).Varint(2, type);
  for (const Wire& state : states) track.Message(3, state);
  return track;
}

Wire Point(double x, double y) { return Wire().Double(1, x).Double(2, y).Double(3, 7.0); }

// Three steps, 0.1 s apart; the second is the present.
Wire Recording(const std::vector<Wire>& tracks) {
  Wire recording = Wire().Double(1, 0.0).Double(1, 0.1).Double(1, 0.2);
  for (const Wire& track : tracks) recording.Message(2, track);
  return recording.Bytes(5, "scene").Varint(10, 1);
}

Wire MovingTrack(int id) { return Track(id, 1, {State(1, 2), State(3, 4), State(5, 6)}); }

v1::Scenario Parse(const Wire& recording) {
  const auto scenario = ParseWaymoScenario(recording.bytes());
  EXPECT_TRUE(scenario.ok()) << scenario.status();
  return scenario.ok() ? *scenario : v1::Scenario();
}

TEST(WaymoReaderTest, MapsTracksToAgents) {
  const v1::Scenario scenario = Parse(Recording({MovingTrack(17)}));
  EXPECT_EQ(scenario.scenario_id(), "scene");
  EXPECT_DOUBLE_EQ(scenario.prediction_time(), 0.1);
  ASSERT_EQ(scenario.agents_size(), 1);
  const v1::Agent& agent = scenario.agents(0);
  EXPECT_EQ(agent.id(), 17);
  EXPECT_EQ(agent.type(), v1::AGENT_TYPE_VEHICLE);
  EXPECT_DOUBLE_EQ(agent.length(), 4.5);
  EXPECT_DOUBLE_EQ(agent.width(), 2.0);
  ASSERT_EQ(agent.states_size(), 3);
  const v1::AgentState& state = agent.states(1);
  EXPECT_DOUBLE_EQ(state.time(), 0.1);
  EXPECT_DOUBLE_EQ(state.x(), 3.0);
  EXPECT_DOUBLE_EQ(state.y(), 4.0);
  EXPECT_FLOAT_EQ(state.heading(), 0.25f);
  EXPECT_FLOAT_EQ(state.velocity_x(), 3.0f);
  EXPECT_FLOAT_EQ(state.velocity_y(), -4.0f);
  EXPECT_THAT(scene::ValidateScenario(scenario, {}), IsEmpty());
}

TEST(WaymoReaderTest, MapsEveryObjectType) {
  std::vector<Wire> tracks;
  for (int type = 0; type <= 4; ++type)
    tracks.push_back(Track(type, type, std::vector<Wire>(3, State(1, 1))));
  const v1::Scenario scenario = Parse(Recording(tracks));
  std::vector<v1::AgentType> types;
  for (const v1::Agent& agent : scenario.agents()) types.push_back(agent.type());
  EXPECT_THAT(types,
              ElementsAre(v1::AGENT_TYPE_UNSPECIFIED, v1::AGENT_TYPE_VEHICLE,
                          v1::AGENT_TYPE_PEDESTRIAN, v1::AGENT_TYPE_CYCLIST, v1::AGENT_TYPE_OTHER));
}

TEST(WaymoReaderTest, KeepsTheValidStatesOfEachAgent) {
  const v1::Scenario scenario =
      Parse(Recording({Track(1, 1, {State(1, 1), NoState(), State(2, 2)}),
                       Track(2, 1, {NoState(), NoState(), NoState()}),
                       Track(3, 1, {State(kNan, 1), State(1, 1), NoState()})}));
  ASSERT_EQ(scenario.agents_size(), 2);
  ASSERT_EQ(scenario.agents(0).states_size(), 2);
  EXPECT_DOUBLE_EQ(scenario.agents(0).states(1).time(), 0.2);
  EXPECT_EQ(scenario.agents(1).id(), 3);
  EXPECT_EQ(scenario.agents(1).states_size(), 1);
}

TEST(WaymoReaderTest, TakesTheSizeNearestToThePresent) {
  const v1::Scenario scenario =
      Parse(Recording({Track(1, 1, {State(1, 1, 4), State(1, 1, 5), State(1, 1, 6)}),
                       Track(2, 1, {NoState(), State(1, 1, 0, 0), State(1, 1, 6)})}));
  EXPECT_DOUBLE_EQ(scenario.agents(0).length(), 5.0);
  EXPECT_DOUBLE_EQ(scenario.agents(1).length(), 6.0);
}

TEST(WaymoReaderTest, AgentsWithoutASizeGetOneTypicalOfTheirType) {
  const auto sizeless = [](int id, int type) {
    return Track(id, type, std::vector<Wire>(3, State(1, 1, 0, 0)));
  };
  const v1::Scenario scenario = Parse(Recording({sizeless(1, 1), sizeless(2, 2), sizeless(3, 3)}));
  ASSERT_EQ(scenario.agents_size(), 3);
  EXPECT_NEAR(scenario.agents(0).length(), 4.6, 0.3);
  EXPECT_NEAR(scenario.agents(0).width(), 2.1, 0.3);
  EXPECT_NEAR(scenario.agents(1).length(), 0.9, 0.3);
  EXPECT_NEAR(scenario.agents(2).length(), 1.8, 0.3);
  EXPECT_EQ(scenario.agents(0).states_size(), 3);
  EXPECT_THAT(scene::ValidateScenario(scenario, {}), IsEmpty());
}

TEST(WaymoReaderTest, TargetsAreTracksToPredictWithAStateNow) {
  Wire recording = Recording(
      {MovingTrack(10), MovingTrack(20), Track(30, 1, {State(1, 1), NoState(), State(1, 1)})});
  for (const int index : {1, 1, 2, 7}) recording.Message(11, Wire().Varint(1, index).Varint(2, 2));
  EXPECT_THAT(Parse(recording).target_ids(), ElementsAre(20));
}

TEST(WaymoReaderTest, WithoutTracksToPredictThereAreNoTargets) {
  EXPECT_THAT(Parse(Recording({MovingTrack(10)})).target_ids(), IsEmpty());
}

TEST(WaymoReaderTest, MapsMapFeatures) {
  const auto polyline = [](int field) {
    return Wire().Message(field, Point(1, 2)).Message(field, Point(3, 4));
  };
  const auto lane = [&](int type) { return polyline(8).Double(1, 25.0).Varint(2, type); };
  Wire recording = Recording({MovingTrack(1)});
  recording.Message(8, Wire().Varint(1, 100).Message(3, lane(0)));
  recording.Message(8, Wire().Varint(1, 101).Message(3, lane(1)));
  recording.Message(8, Wire().Varint(1, 102).Message(3, lane(2)));
  recording.Message(8, Wire().Varint(1, 103).Message(3, lane(3)));
  recording.Message(8, Wire().Varint(1, 104).Message(4, polyline(2).Varint(1, 7)));
  recording.Message(8, Wire().Varint(1, 105).Message(5, polyline(2).Varint(1, 2)));
  recording.Message(
      8, Wire().Varint(1, 106).Message(7, Wire().Varint(1, 100).Message(2, Point(8, 9))));
  recording.Message(8, Wire().Varint(1, 107).Message(8, polyline(1)));
  recording.Message(8, Wire().Varint(1, 108).Message(9, polyline(1)));
  recording.Message(8, Wire().Varint(1, 109).Message(10, polyline(1)));
  recording.Message(8, Wire().Varint(1, 110).Message(4, Wire()));               // no points
  recording.Message(8, Wire().Varint(1, 111).Message(7, Wire().Varint(1, 5)));  // no position
  recording.Message(8, Wire().Varint(1, 112).Message(99, Wire()));              // not known yet
  const v1::Scenario scenario = Parse(recording);
  std::vector<v1::MapFeatureType> types;
  std::vector<int64_t> ids;
  for (const v1::MapFeature& feature : scenario.map_features()) {
    types.push_back(feature.type());
    ids.push_back(feature.id());
  }
  EXPECT_THAT(ids, ElementsAre(100, 101, 102, 103, 104, 105, 106, 107, 108, 109));
  EXPECT_THAT(
      types, ElementsAre(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE,
                         v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, v1::MAP_FEATURE_TYPE_BIKE_LANE,
                         v1::MAP_FEATURE_TYPE_ROAD_LINE, v1::MAP_FEATURE_TYPE_ROAD_EDGE,
                         v1::MAP_FEATURE_TYPE_STOP_SIGN, v1::MAP_FEATURE_TYPE_CROSSWALK,
                         v1::MAP_FEATURE_TYPE_SPEED_BUMP, v1::MAP_FEATURE_TYPE_DRIVEWAY));
  EXPECT_THAT(scenario.map_features(0).x(), ElementsAre(1.0, 3.0));
  EXPECT_THAT(scenario.map_features(0).y(), ElementsAre(2.0, 4.0));
  // 25 miles per hour, 1609.344 m per mile.
  EXPECT_NEAR(scenario.map_features(0).speed_limit(), 25.0 * 1609.344 / 3600.0, 1e-12);
  EXPECT_EQ(scenario.map_features(4).speed_limit(), 0.0);
  EXPECT_THAT(scenario.map_features(6).x(), ElementsAre(8.0));
  EXPECT_THAT(scene::ValidateScenario(scenario, {}), IsEmpty());
}

TEST(WaymoReaderTest, LanesDeclareTheirSuccessorsAndNeighbors) {
  const auto lane = [] { return Wire().Message(8, Point(1, 2)).Message(8, Point(3, 4)); };
  const auto neighbor = [](int id) { return Wire().Varint(1, id).Varint(2, 5); };
  Wire recording = Recording({MovingTrack(1)});
  recording.Message(
      8, Wire().Varint(1, 100).Message(3, lane()
                                              .Bytes(10, "\x65\x66")  // packed: 101 and 102
                                              .Message(11, neighbor(104))
                                              .Message(12, neighbor(105))
                                              .Message(12, neighbor(106))));
  recording.Message(8, Wire().Varint(1, 101).Message(3, lane().Bytes(9, "\x64")));
  // Lane 100 does not declare its successor 103, but 103 does. Lane 99 does not exist.
  recording.Message(8, Wire().Varint(1, 103).Message(3, lane().Varint(9, 100).Varint(9, 99)));
  const v1::Scenario scenario = Parse(recording);
  ASSERT_EQ(scenario.map_features_size(), 3);
  EXPECT_THAT(scenario.map_features(0).successor_ids(), ElementsAre(101, 102, 103));
  EXPECT_THAT(scenario.map_features(0).left_neighbor_ids(), ElementsAre(104));
  EXPECT_THAT(scenario.map_features(0).right_neighbor_ids(), ElementsAre(105, 106));
  EXPECT_THAT(scenario.map_features(1).successor_ids(), IsEmpty());
}

TEST(WaymoReaderTest, ALaneDeclaresNoMoreSuccessorsThanAScenarioMayHave) {
  Wire lane = Wire().Message(8, Point(1, 2)).Message(8, Point(3, 4));
  for (int id = 1; id <= 100; ++id) lane.Varint(10, id);
  Wire recording = Recording({MovingTrack(1)});
  recording.Message(8, Wire().Varint(1, 100).Message(3, lane));
  const v1::Scenario scenario = Parse(recording);
  EXPECT_EQ(scenario.map_features(0).successor_ids_size(), 64);
  EXPECT_THAT(scene::ValidateScenario(scenario, {}), IsEmpty());
}

// One step: lane -> state.
Wire Signals(const std::vector<std::pair<int, int>>& lanes) {
  Wire step;
  for (const auto& [lane, state] : lanes) {
    step.Message(1, Wire().Varint(1, lane).Varint(2, state).Message(3, Point(0, 0)));
  }
  return step;
}

std::vector<std::pair<double, v1::TrafficSignalState>> Readings(const v1::TrafficSignal& signal) {
  std::vector<std::pair<double, v1::TrafficSignalState>> readings;
  for (const auto& reading : signal.readings())
    readings.emplace_back(reading.time(), reading.state());
  return readings;
}

TEST(WaymoReaderTest, SignalsHaveAReadingWhereTheyChange) {
  Wire recording = Recording({MovingTrack(1)});
  recording.Message(7, Signals({{50, 4}, {60, 6}}));
  recording.Message(7, Signals({{50, 4}, {60, 5}, {70, 3}}));
  recording.Message(7, Signals({{50, 6}, {70, 3}}));
  const v1::Scenario scenario = Parse(recording);
  ASSERT_EQ(scenario.traffic_signals_size(), 3);
  EXPECT_EQ(scenario.traffic_signals(0).lane_id(), 50);
  EXPECT_THAT(Readings(scenario.traffic_signals(0)),
              ElementsAre(std::pair(0.0, v1::TRAFFIC_SIGNAL_STATE_STOP),
                          std::pair(0.2, v1::TRAFFIC_SIGNAL_STATE_GO)));
  // Absent in the last step, so it is unknown there.
  EXPECT_THAT(Readings(scenario.traffic_signals(1)),
              ElementsAre(std::pair(0.0, v1::TRAFFIC_SIGNAL_STATE_GO),
                          std::pair(0.1, v1::TRAFFIC_SIGNAL_STATE_CAUTION),
                          std::pair(0.2, v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED)));
  EXPECT_THAT(Readings(scenario.traffic_signals(2)),
              ElementsAre(std::pair(0.1, v1::TRAFFIC_SIGNAL_STATE_GO)));
}

TEST(WaymoReaderTest, MapsEverySignalState) {
  const v1::TrafficSignalState expected[] = {
      v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED, v1::TRAFFIC_SIGNAL_STATE_STOP,
      v1::TRAFFIC_SIGNAL_STATE_CAUTION,     v1::TRAFFIC_SIGNAL_STATE_GO,
      v1::TRAFFIC_SIGNAL_STATE_STOP,        v1::TRAFFIC_SIGNAL_STATE_CAUTION,
      v1::TRAFFIC_SIGNAL_STATE_GO,          v1::TRAFFIC_SIGNAL_STATE_STOP,
      v1::TRAFFIC_SIGNAL_STATE_CAUTION};
  for (int state = 0; state <= 8; ++state) {
    Wire recording = Recording({MovingTrack(1)});
    recording.Message(7, Signals({{50, state}}));
    EXPECT_EQ(Parse(recording).traffic_signals(0).readings(0).state(), expected[state]) << state;
  }
}

TEST(WaymoReaderTest, SkipsUnknownSensorMessages) {
  Wire recording = Recording({MovingTrack(1)});
  recording.Bytes(12, std::string(1000, '\xff')).Bytes(13, "x").Varint(6, 0).Varint(4, 3);
  EXPECT_EQ(Parse(recording).agents_size(), 1);
}

TEST(WaymoReaderTest, ARecordingWithoutAnIdGetsOneFromItsContent) {
  const auto anonymous = [](double x) {
    return Wire().Double(1, 0.0).Message(2, Track(1, 1, {State(x, 0)})).Varint(10, 0);
  };
  const std::string id = Parse(anonymous(1.0)).scenario_id();
  EXPECT_THAT(id, MatchesRegex("nosid-[0-9a-f]+"));
  EXPECT_EQ(id.size(), 14u);
  EXPECT_EQ(Parse(anonymous(1.0)).scenario_id(), id);
  EXPECT_NE(Parse(anonymous(2.0)).scenario_id(), id);
}

TEST(WaymoReaderTest, RefusesBytesThatAreNotARecording) {
  const auto code = [](const std::string& bytes) {
    return ParseWaymoScenario(bytes).status().code();
  };
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  EXPECT_EQ(code("\xff\xff\xff"), kInvalid);
  EXPECT_EQ(code(""), kInvalid);
  EXPECT_EQ(code(Recording({}).bytes()), kInvalid) << "no tracks";
  EXPECT_EQ(code(Recording({Track(1, 1, {State(1, 1)})}).bytes()), kInvalid) << "too few states";
  EXPECT_EQ(code(Recording({MovingTrack(1)}).Varint(10, 3).bytes()), kInvalid)
      << "the present is not a step";
  Wire unordered = Wire().Double(1, 0.1).Double(1, 0.1).Varint(10, 0);
  unordered.Message(2, Track(1, 1, {State(1, 1), State(1, 1)}));
  EXPECT_EQ(code(unordered.bytes()), kInvalid) << "time stands still";
}

TEST(WaymoReaderTest, RefusesARecordingOfMorePartsThanAnyHas) {
  const auto problem = [](const std::string& bytes) {
    return std::string(ParseWaymoScenario(bytes).status().message());
  };
  const auto many = [](int field) {
    const std::string empty = Wire().Bytes(field, "").bytes();
    std::string parts;
    for (int i = 0; i <= 2'000'000; ++i) parts += empty;
    return parts;
  };
  const std::string states = Wire().Bytes(2, many(3)).bytes();
  const std::string points_of_a_lane = Wire().Message(8, Wire().Bytes(3, many(8))).bytes();
  const std::string tracks = many(2);
  for (const std::string& bytes : {states, points_of_a_lane, tracks}) {
    EXPECT_THAT(problem(bytes), HasSubstr("at most 2000000"));
  }
  // What is in a group would not be counted.
  EXPECT_EQ(problem(Recording({MovingTrack(1)}).bytes() + "\x63\x64"),
            "not a serialised Waymo scenario");
}

TEST(WaymoReaderTest, RefusesMoreTimesOrSignalsThanAScenarioMayHave) {
  Wire long_recording;
  Wire track = Wire().Varint(1, 1).Varint(2, 1);
  for (int i = 0; i <= scene::ScenarioLimits().max_states_per_agent; ++i) {
    long_recording.Double(1, 0.1 * i);
    track.Message(3, State(1, 1));
  }
  const auto many_times = ParseWaymoScenario(long_recording.Message(2, track).bytes());
  EXPECT_THAT(std::string(many_times.status().message()),
              HasSubstr("timestamps_seconds has 2001 times; at most 2000"));
  std::vector<std::pair<int, int>> lit;
  for (int lane = 0; lane <= scene::ScenarioLimits().max_traffic_signals; ++lane) {
    lit.emplace_back(lane + 1, 4);
  }
  const auto many_signals =
      ParseWaymoScenario(Recording({MovingTrack(1)}).Message(7, Signals(lit)).bytes());
  EXPECT_THAT(std::string(many_signals.status().message()),
              HasSubstr("signals of 2001 lanes; at most 2000"));
}

}  // namespace
}  // namespace maneuver::data::waymo_reader_test
