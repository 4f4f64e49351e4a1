#include "model/scene/scene_reader.h"

#include <cmath>

#include "model/scene/target_frame.h"
#include "model/scene/target_history.h"

namespace maneuver::scene {
namespace {

// Returns the time that the vectors describe, for which the target's frame holds.
double DescribedTime(const v1::Agent& agent, double time, int inputs_version) {
  if (inputs_version >= 3) return time;
  const int latest = FindState(agent, time, HUGE_VAL, time + kSameTime);
  return latest < 0 ? time : agent.states(latest).time();
}

}  // namespace

SceneReader::SceneReader(const v1::ModelSpec& spec) : spec_(spec) {
  if (spec.has_raster()) rasterizer_.emplace(spec.raster());
  if (spec.scene_vectors().path_width() > 0) lane_paths_.emplace(spec.inputs_version());
}

SceneInputs SceneReader::NewInputs() const {
  SceneInputs inputs;
  if (spec_.has_raster()) inputs.raster = NewRaster(spec_.raster());
  return inputs;
}

void SceneReader::Read(const v1::Scenario& scenario, const RoadMap& map, double time,
                       int64_t target_id, const Pose2& X_WT, SceneInputs* inputs) {
  ReadRaster(scenario, map, time, target_id, X_WT, inputs);
  ReadVectors(scenario, map, time, target_id, X_WT, inputs);
}

void SceneReader::ReadRaster(const v1::Scenario& scenario, const RoadMap& map, double time,
                             int64_t target_id, const Pose2& X_WT, SceneInputs* inputs) {
  if (rasterizer_) {
    rasterizer_->Rasterize(scenario, map, time, target_id, X_WT, {}, &*inputs->raster);
  }
  if (!spec_.target_motion()) return;
  const v1::Agent* const agent = FindAgent(scenario, target_id);
  inputs->motion = agent == nullptr ? MotionInputs{} : DescribeMotion(*agent, time);
}

void SceneReader::ReadVectors(const v1::Scenario& scenario, const RoadMap& map, double time,
                              int64_t target_id, const Pose2& X_WT, SceneInputs* inputs) {
  if (!spec_.has_scene_vectors()) return;
  const v1::Agent* const agent = FindAgent(scenario, target_id);
  const int version = spec_.inputs_version();
  const double present = agent == nullptr ? time : DescribedTime(*agent, time, version);
  const TargetHistory history =
      agent == nullptr ? TargetHistory() : ResampleHistory(*agent, present, X_WT);
  SceneVectors& vectors = inputs->vectors;
  vectors.motion = EstimateMotion(history);
  vectors.history = DescribeHistory(history, vectors.motion);
  if (lane_paths_) {
    lane_paths_->Find(scenario, map.lanes(), present, target_id, X_WT, vectors.motion.speed, {},
                      &vectors.paths);
  }
  if (spec_.scene_vectors().agent_width() > 0) {
    DescribeAgents(scenario, present, target_id, X_WT, vectors.motion.speed, {}, version,
                   &vectors.agents);
  }
}

}  // namespace maneuver::scene
