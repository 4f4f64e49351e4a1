#include "model/scene/scene_reader.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <tuple>

#include "model/scene/target_frame.h"
#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::scene_reader_test {
namespace {

constexpr int64_t kTarget = 7;

v1::ModelSpec RasterModel() {
  v1::ModelSpec spec;
  *spec.mutable_raster() = SmallSpec();
  spec.set_target_motion(true);
  return spec;
}

v1::ModelSpec VectorModel() {
  v1::ModelSpec spec;
  spec.mutable_scene_vectors()->set_history_width(8);
  spec.set_inputs_version(kLatestInputsVersion);
  return spec;
}

v1::ModelSpec AgentModel() {
  v1::ModelSpec spec = VectorModel();
  spec.mutable_scene_vectors()->set_agent_width(8);
  return spec;
}

v1::ModelSpec LaneModel() {
  v1::ModelSpec spec = VectorModel();
  spec.mutable_scene_vectors()->set_path_width(8);
  return spec;
}

// Returns a scene with a vehicle that heads north and brakes at 2 m/s^2, at 10 m/s at 1 s, with
// states every 0.1 s until `last`, seconds. Another one stands 4 m ahead of its position at 1 s. A
// lane runs north.
v1::Scenario Braking(double last = 3.0) {
  v1::Scenario scenario;
  v1::Agent* const target = AddAgent(&scenario, kTarget, v1::AGENT_TYPE_VEHICLE, 4.0, 2.0);
  for (int i = 0; 0.1 * i < last + 0.05; ++i) {
    const double t = 0.1 * i - 1.0;
    AddState(target, 0.1 * i, 3.0, 10.0 * t - t * t, M_PI / 2);
    v1::AgentState& state = *target->mutable_states(i);
    state.set_velocity_y(static_cast<float>(10.0 - 2.0 * t));
  }
  v1::Agent* const other = AddAgent(&scenario, 8, v1::AGENT_TYPE_VEHICLE, 2.0, 2.0);
  AddState(other, 1.0, 3.0, 4.0, 0.0);
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {{2.5, -50.0}, {2.5, 200.0}});
  return scenario;
}

SceneInputs Read(const v1::ModelSpec& spec, const v1::Scenario& scenario, double time,
                 int64_t target_id = kTarget) {
  SceneReader reader(spec);
  SceneInputs inputs = reader.NewInputs();
  const v1::Agent* const agent = FindAgent(scenario, target_id);
  const Pose2 X_WT =
      agent == nullptr ? Pose2() : *TargetPose(*agent, time, 0.15, spec.inputs_version());
  reader.Read(scenario, RoadMap::Over(scenario.map_features()), time, target_id, X_WT, &inputs);
  return inputs;
}

std::vector<uint8_t> BytesOf(const Raster& raster) {
  std::vector<uint8_t> bytes(raster.values());
  raster.WriteInterleaved(bytes);
  return bytes;
}

void ExpectSameVectors(const SceneVectors& a, const SceneVectors& b) {
  EXPECT_EQ(a.history, b.history);
  EXPECT_EQ(a.paths.count, b.paths.count);
  EXPECT_EQ(a.paths.values, b.paths.values);
  EXPECT_EQ(a.agents.count, b.agents.count);
  EXPECT_EQ(a.agents.values, b.agents.values);
  EXPECT_EQ(a.motion.speed, b.motion.speed);
  EXPECT_EQ(a.motion.acceleration, b.motion.acceleration);
  EXPECT_EQ(a.motion.turn_rate, b.motion.turn_rate);
}

TEST(SceneReaderTest, DrawsTheRasterOfAModelThatHasOne) {
  const v1::Scenario scenario = Braking();
  const SceneInputs inputs = Read(RasterModel(), scenario, 1.0);
  ASSERT_TRUE(inputs.raster.has_value());
  const Pose2 X_WT = *TargetPose(scenario.agents(0), 1.0, 0.0);
  EXPECT_EQ(BytesOf(*inputs.raster), Draw(SmallSpec(), scenario, 1.0, kTarget, X_WT).bytes());
  EXPECT_EQ(inputs.motion, DescribeMotion(scenario.agents(0), 1.0));
  EXPECT_FLOAT_EQ(inputs.motion[0], 1.0F);  // in 10 m/s
}

TEST(SceneReaderTest, ReadsTheHistoryOfAModelWithSceneVectors) {
  const SceneInputs inputs = Read(VectorModel(), Braking(), 1.0);
  EXPECT_FALSE(inputs.raster.has_value());
  EXPECT_EQ(inputs.motion, MotionInputs{});
  EXPECT_NEAR(inputs.vectors.motion.speed, 10.0, 1e-5);
  EXPECT_NEAR(inputs.vectors.motion.acceleration, -2.0, 1e-4);
  EXPECT_NEAR(inputs.vectors.motion.turn_rate, 0.0, 1e-9);
  EXPECT_NEAR(inputs.vectors.history[0], 1.0, 1e-6);   // speed / 10 m/s
  EXPECT_NEAR(inputs.vectors.history[2], -1.0, 1e-4);  // acceleration / 2 m/s^2
  // The state one second ago is 11 m behind; constant velocity gives 10 m.
  EXPECT_NEAR(inputs.vectors.history[9], -1.0, 1e-4);
}

TEST(SceneReaderTest, ReadsBothForAModelWithBoth) {
  v1::ModelSpec spec = VectorModel();
  *spec.mutable_raster() = SmallSpec();
  const SceneInputs inputs = Read(spec, Braking(), 1.0);
  EXPECT_EQ(BytesOf(*inputs.raster), BytesOf(*Read(RasterModel(), Braking(), 1.0).raster));
  ExpectSameVectors(inputs.vectors, Read(VectorModel(), Braking(), 1.0).vectors);
}

TEST(SceneReaderTest, ReadsNothingLater) {
  ExpectSameVectors(Read(VectorModel(), Braking(3.0), 1.0).vectors,
                    Read(VectorModel(), Braking(1.0), 1.0).vectors);
}

// Returns a scene with a target that drives 30 m/s north, and a vehicle 20 m ahead that drives 25
// m/s, with states every 0.1 s until `last`. A lane runs north.
v1::Scenario Cruising(double last) {
  v1::Scenario scenario;
  for (const auto& [id, y, speed] : {std::tuple(kTarget, 0.0, 30.0), {int64_t{8}, 20.0, 25.0}}) {
    v1::Agent* const agent = AddAgent(&scenario, id, v1::AGENT_TYPE_VEHICLE, 4.0, 2.0);
    for (int i = 0; 0.1 * i < last + 0.05; ++i) {
      AddState(agent, 0.1 * i, 3.0, y + 0.1 * i * speed, M_PI / 2);
      agent->mutable_states(i)->set_velocity_y(static_cast<float>(speed));
    }
  }
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {{2.5, -50.0}, {2.5, 300.0}});
  return scenario;
}

template <typename Values>
void ExpectNear(const Values& values, const Values& expected) {
  for (size_t i = 0; i < values.size(); ++i) EXPECT_NEAR(values[i], expected[i], 1e-5) << i;
}

// Planners ask between two states, and trackers report late.
TEST(SceneReaderTest, WhoseLatestStateIsALittleOldHasGoneOn) {
  for (const v1::ModelSpec& spec : {LaneModel(), AgentModel()}) {
    const SceneVectors vectors = Read(spec, Cruising(1.0), 1.1).vectors;
    const SceneVectors expected = Read(spec, Cruising(1.1), 1.1).vectors;
    ExpectNear(vectors.history, expected.history);
    ExpectNear(vectors.paths.values, expected.paths.values);
    ExpectNear(vectors.agents.values, expected.agents.values);
    EXPECT_EQ(vectors.agents.count, expected.agents.count);
  }
}

TEST(SceneReaderTest, InEarlierVersionsThePresentIsTheLatestState) {
  for (v1::ModelSpec spec : {LaneModel(), AgentModel()}) {
    spec.set_inputs_version(2);
    ExpectSameVectors(Read(spec, Braking(1.0), 1.08).vectors,
                      Read(spec, Braking(1.0), 1.0).vectors);
  }
}

// The lane runs north, 0.5 m to the left of the target; the other vehicle stands on it.
TEST(SceneReaderTest, ReadsTheLanePathsOfAModelThatAsksForThem) {
  const SceneInputs inputs = Read(LaneModel(), Braking(), 1.0);
  const LanePathInputs& paths = inputs.vectors.paths;
  ASSERT_EQ(paths.count, 1);
  EXPECT_NEAR(paths.values[0], 0.5, 1e-5);    // 2.5 m ahead, divided by 5 m
  EXPECT_NEAR(paths.values[1], 0.1, 1e-5);    // 0.5 m to the left, divided by 5 m
  EXPECT_NEAR(paths.values[62], -0.5, 1e-5);  // the target is 0.5 m to the right of the lane
  EXPECT_EQ(paths.values[69], 1.0F);          // there is a leader
  EXPECT_NEAR(paths.values[70], (4.0 - 3.0) / 30.0, 1e-5);  // its gap
  EXPECT_NEAR(paths.values[72], -1.0, 1e-5);  // it stands: 10 m/s less than the target
  EXPECT_EQ(Read(VectorModel(), Braking(), 1.0).vectors.paths.count, 0);
}

// The other vehicle stands 4 m ahead of the target, which drives 10 m/s.
TEST(SceneReaderTest, ReadsTheAgentsOfAModelThatAsksForThem) {
  const AgentInputs agents = Read(AgentModel(), Braking(), 1.0).vectors.agents;
  ASSERT_EQ(agents.count, 1);
  EXPECT_NEAR(agents.values[0], 0.2, 1e-6);         // 4 m ahead, divided by 20 m
  EXPECT_NEAR(agents.values[8], -1.0, 1e-6);        // 10 m/s less than the target
  EXPECT_NEAR(agents.values[19], 0.4 / 4.0, 1e-6);  // reached after 0.4 s
  EXPECT_EQ(Read(AgentModel(), Braking(), 1.0).vectors.paths.count, 0);
  EXPECT_EQ(Read(LaneModel(), Braking(), 1.0).vectors.agents.count, 0);
}

TEST(SceneReaderTest, ReadsAnEmptySceneAsAStandingTarget) {
  const SceneInputs inputs = Read(VectorModel(), v1::Scenario(), 0.0);
  EXPECT_EQ(inputs.vectors.motion.speed, 0.0);
  EXPECT_EQ(inputs.vectors.history[0], 0.0F);
  EXPECT_EQ(inputs.vectors.history[39], 1.0F);  // e^(-|v| / 0.5)
}

TEST(SceneReaderTest, OverwritesTheInputsOfAnotherScene) {
  v1::ModelSpec spec = LaneModel();
  spec.mutable_scene_vectors()->set_agent_width(8);
  *spec.mutable_raster() = SmallSpec();
  spec.set_target_motion(true);
  SceneReader reader(spec);
  SceneInputs inputs = reader.NewInputs();
  const v1::Scenario scenario = Braking();
  const v1::Scenario empty;
  reader.Read(scenario, RoadMap::Over(scenario.map_features()), 1.0, kTarget,
              *TargetPose(scenario.agents(0), 1.0, 0.0), &inputs);
  reader.Read(empty, RoadMap::Over(empty.map_features()), 0.0, kTarget, Pose2(), &inputs);
  const SceneInputs fresh = Read(spec, empty, 0.0);
  EXPECT_EQ(BytesOf(*inputs.raster), BytesOf(*fresh.raster));
  EXPECT_EQ(inputs.motion, fresh.motion);
  ExpectSameVectors(inputs.vectors, fresh.vectors);
}

}  // namespace
}  // namespace maneuver::scene::scene_reader_test
