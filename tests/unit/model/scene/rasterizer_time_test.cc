// Frames of the past, gaps and signals, and nothing from the future.
#include <gtest/gtest.h>

#include <cmath>

#include "model/scene/rasterizer.h"
#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::rasterizer_time_test {
namespace {

constexpr int64_t kTarget = 1;
constexpr int kTargetFrames = 3;  // channels of SmallSpec
constexpr int kOtherFrames = 6;
const Pose2 kOrigin;

// Returns the column of the only nonzero pixel of row 5 in a channel, or -1.
int NonzeroColumn(const Picture& raster, int channel) {
  int nonzero = -1;
  for (int column = 0; column < 16; ++column) {
    if (raster.at(5, column, channel) == 0) continue;
    EXPECT_EQ(nonzero, -1) << "two nonzero pixels in channel " << channel;
    nonzero = column;
  }
  return nonzero;
}

// Adds an agent of 1 m x 1 m, which covers one pixel of row 5 in each state.
v1::Agent* AddSpot(v1::Scenario* scenario, int64_t id) {
  return AddAgent(scenario, id, v1::AGENT_TYPE_VEHICLE, 1, 1);
}
void AddSpotState(v1::Agent* agent, double time, int column) {
  AddState(agent, time, column - 8 + 0.5, 0.5, 0);
}

TEST(HistoryTest, FramesRunBackwardsFromNow) {
  v1::Scenario scenario;
  v1::Agent* target = AddSpot(&scenario, kTarget);
  v1::Agent* other = AddSpot(&scenario, 2);
  for (int i = 0; i <= 10; ++i) {
    AddSpotState(target, 0.1 * i, i);
    AddSpotState(other, 0.1 * i, i + 5);
  }
  const Picture raster = Draw(SmallSpec(), scenario, 1.0, kTarget, kOrigin);
  for (int frame = 0; frame < 3; ++frame) {
    EXPECT_EQ(NonzeroColumn(raster, kTargetFrames + frame), 10 - frame);
    EXPECT_EQ(NonzeroColumn(raster, kOtherFrames + frame), 15 - frame);
  }
}

TEST(HistoryTest, TakesTheStateNearestToEachFrame) {
  v1::Scenario scenario;
  v1::Agent* agent = AddSpot(&scenario, 2);
  AddSpotState(agent, 0.76, 1);
  AddSpotState(agent, 0.81, 2);
  AddSpotState(agent, 0.86, 3);  // 0.04 from frame 1
  AddSpotState(agent, 0.92, 4);  // 0.02 from frame 1
  AddSpotState(agent, 0.97, 5);
  const Picture raster = Draw(SmallSpec(), scenario, 1.0, kTarget, kOrigin);
  EXPECT_EQ(NonzeroColumn(raster, kOtherFrames + 0), 5);
  EXPECT_EQ(NonzeroColumn(raster, kOtherFrames + 1), 4);
  EXPECT_EQ(NonzeroColumn(raster, kOtherFrames + 2), 2);
}

TEST(HistoryTest, GapsStayEmpty) {
  v1::Scenario scenario;
  v1::Agent* agent = AddSpot(&scenario, 2);
  AddSpotState(agent, 0.8, 3);
  AddSpotState(agent, 0.84, 4);  // 0.06 from frame 1: absent from it
  AddSpotState(agent, 1.0, 5);
  const Picture raster = Draw(SmallSpec(), scenario, 1.0, kTarget, kOrigin);
  EXPECT_EQ(NonzeroColumn(raster, kOtherFrames + 0), 5);
  EXPECT_EQ(raster.Sum(kOtherFrames + 1), 0);
  EXPECT_EQ(NonzeroColumn(raster, kOtherFrames + 2), 3);
}

TEST(HistoryTest, AnAgentThatHasLeftOrNotYetAppearedIsAbsentNow) {
  v1::Scenario scenario;
  AddSpotState(AddSpot(&scenario, 2), 0.9, 3);  // gone since
  AddSpotState(AddSpot(&scenario, 3), 1.1, 6);  // comes later
  AddSpot(&scenario, 4);                        // never there
  const Picture raster = Draw(SmallSpec(), scenario, 1.0, kTarget, kOrigin);
  EXPECT_EQ(raster.Sum(kOtherFrames), 0);
  EXPECT_EQ(NonzeroColumn(raster, kOtherFrames + 1), 3);
}

TEST(FutureTest, ReadsNothingLaterThanNow) {
  v1::Scenario scenario;
  for (int id = 1; id <= 4; ++id) {
    v1::Agent* agent = AddAgent(&scenario, id, v1::AGENT_TYPE_VEHICLE, 4, 2);
    // Agent 3 has its states slightly off the frames, one of them soon after now.
    const double offset = id == 3 ? 0.03 : 0.0;
    for (int i = 0; i < 30; ++i) {
      AddState(agent, 0.1 * i + offset, 0.3 * i - 4 + id, id - 2, 0.1 * i);
    }
  }
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {{-9, 1}, {9, 2}})->set_id(5);
  v1::TrafficSignal* signal = scenario.add_traffic_signals();
  signal->set_lane_id(5);
  signal->add_readings()->set_time(0.0);
  v1::TrafficSignalReading* reading = signal->add_readings();
  reading->set_time(1.01);
  reading->set_state(v1::TRAFFIC_SIGNAL_STATE_STOP);

  v1::Scenario altered = scenario;
  v1::Scenario removed = scenario;
  for (int a = 0; a < scenario.agents_size(); ++a) {
    int past = 0;
    for (v1::AgentState& state : *altered.mutable_agents(a)->mutable_states()) {
      if (state.time() <= 1.0 + 1e-6) {
        ++past;
        continue;
      }
      state.set_x(-state.x());
      state.set_y(0.5);
      state.set_heading(2.0F);
    }
    auto* states = removed.mutable_agents(a)->mutable_states();
    states->DeleteSubrange(past, states->size() - past);
  }
  removed.mutable_traffic_signals(0)->mutable_readings()->RemoveLast();

  const Picture whole = Draw(SmallSpec(), scenario, 1.0, kTarget, kOrigin);
  EXPECT_GT(whole.Sum(kTargetFrames), 0);
  EXPECT_EQ(Draw(SmallSpec(), altered, 1.0, kTarget, kOrigin).bytes(), whole.bytes());
  EXPECT_EQ(Draw(SmallSpec(), removed, 1.0, kTarget, kOrigin).bytes(), whole.bytes());
  // The same change in the past shows.
  altered.mutable_agents(1)->mutable_states(10)->set_y(2.5);
  EXPECT_NE(Draw(SmallSpec(), altered, 1.0, kTarget, kOrigin).bytes(), whole.bytes());
}

TEST(FutureTest, TheGivenTimeReplacesThePredictionTime) {
  v1::Scenario scenario;
  scenario.set_prediction_time(0.0);
  v1::Agent* agent = AddSpot(&scenario, 2);
  for (int i = 0; i <= 9; ++i) AddSpotState(agent, 0.1 * i, i);
  EXPECT_EQ(NonzeroColumn(Draw(SmallSpec(), scenario, 0.7, kTarget, kOrigin), kOtherFrames), 7);
}

class SignalTest : public testing::Test {
 protected:
  SignalTest() {
    AddFeature(&scenario_, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {{-9, 0.5}, {9, 0.5}})->set_id(5);
  }
  void AddReading(int64_t lane, double time, v1::TrafficSignalState state) {
    v1::TrafficSignal* signal = nullptr;
    for (v1::TrafficSignal& each : *scenario_.mutable_traffic_signals()) {
      if (each.lane_id() == lane) signal = &each;
    }
    if (signal == nullptr) signal = scenario_.add_traffic_signals();
    signal->set_lane_id(lane);
    v1::TrafficSignalReading* reading = signal->add_readings();
    reading->set_time(time);
    reading->set_state(state);
  }
  int LaneAt(double time) const {
    return Draw(SmallSpec(), scenario_, time, kTarget, kOrigin).at(5, 8, kLaneChannel);
  }

  v1::Scenario scenario_;
};

TEST_F(SignalTest, LaneShowsTheLatestReading) {
  AddReading(5, 1.0, v1::TRAFFIC_SIGNAL_STATE_GO);
  AddReading(5, 2.0, v1::TRAFFIC_SIGNAL_STATE_CAUTION);
  AddReading(5, 3.0, v1::TRAFFIC_SIGNAL_STATE_STOP);
  AddReading(5, 9.0, v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED);
  EXPECT_EQ(LaneAt(0.5), 255);  // not known yet
  EXPECT_EQ(LaneAt(1.5), 255);
  EXPECT_EQ(LaneAt(1.99), 255);
  EXPECT_EQ(LaneAt(2.0), 176);
  EXPECT_EQ(LaneAt(3.0), 96);
  EXPECT_EQ(LaneAt(8.9), 96);
  EXPECT_EQ(LaneAt(9.1), 255);
}

TEST_F(SignalTest, OtherLanesAreUnaffected) {
  AddReading(6, 0.0, v1::TRAFFIC_SIGNAL_STATE_STOP);
  AddReading(4, 0.0, v1::TRAFFIC_SIGNAL_STATE_STOP);
  EXPECT_EQ(LaneAt(1.0), 255);
}

TEST_F(SignalTest, TheMostRestrictiveOfTwoSignalsCounts) {
  for (const v1::TrafficSignalState state :
       {v1::TRAFFIC_SIGNAL_STATE_CAUTION, v1::TRAFFIC_SIGNAL_STATE_STOP,
        v1::TRAFFIC_SIGNAL_STATE_GO}) {
    v1::TrafficSignal* signal = scenario_.add_traffic_signals();
    signal->set_lane_id(5);
    signal->add_readings()->set_state(state);
  }
  EXPECT_EQ(LaneAt(1.0), 96);
}

TEST_F(SignalTest, LanesWithoutAnIdHaveNoSignal) {
  scenario_.mutable_map_features(0)->set_id(0);
  AddReading(0, 0.0, v1::TRAFFIC_SIGNAL_STATE_STOP);
  EXPECT_EQ(LaneAt(1.0), 255);
}

}  // namespace
}  // namespace maneuver::scene::rasterizer_time_test
