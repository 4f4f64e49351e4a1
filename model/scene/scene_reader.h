// Reads everything about a scene that a model's networks take as input.

#ifndef MANEUVER_MODEL_SCENE_SCENE_READER_H_
#define MANEUVER_MODEL_SCENE_SCENE_READER_H_

#include <cstdint>
#include <optional>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/scene/lane_paths.h"
#include "model/scene/pose2.h"
#include "model/scene/raster.h"
#include "model/scene/rasterizer.h"
#include "model/scene/road_map.h"
#include "model/scene/scene_vectors.h"
#include "model/scene/target_motion.h"

namespace maneuver::scene {

// The inputs of a model's networks, for one target.
struct SceneInputs {
  std::optional<Raster> raster;  // none for a model without a raster
  MotionInputs motion{};         // 0 unless the model asks for it (ModelSpec.target_motion)
  SceneVectors vectors;          // 0 for a model without scene vectors
};

// Reads the parts that a model's spec names: raster, target motion, target history, lane paths,
// agents nearby. Holds scratch memory: use one per thread.
class SceneReader {
 public:
  // artifact::ValidateModelSpec must accept `spec`.
  explicit SceneReader(const v1::ModelSpec& spec);

  // Returns the inputs of an empty scene. Read() overwrites them, so they can be reused.
  SceneInputs NewInputs() const;

  // Reads `scenario` as it was at `time`, which replaces its prediction_time. Reads nothing later.
  // ValidateScenario must accept the scenario.
  //   map: the scenario's own features (RoadMap::Over), or other features that replace them.
  //   target_id, X_WT: the target, and its frame (TargetPose, for the model's inputs_version). A
  //     target that the scenario lacks is described as standing still. With versions 1 and 2 of the
  //     inputs the vectors describe the time of the target's latest state, not `time`. A raster
  //     shows each agent where its states put it.
  //   inputs: from NewInputs().
  void Read(const v1::Scenario& scenario, const RoadMap& map, double time, int64_t target_id,
            const Pose2& X_WT, SceneInputs* inputs);
  // Read the two parts of Read(): raster and motion; scene vectors.
  void ReadRaster(const v1::Scenario& scenario, const RoadMap& map, double time, int64_t target_id,
                  const Pose2& X_WT, SceneInputs* inputs);
  void ReadVectors(const v1::Scenario& scenario, const RoadMap& map, double time, int64_t target_id,
                   const Pose2& X_WT, SceneInputs* inputs);

 private:
  v1::ModelSpec spec_;
  std::optional<Rasterizer> rasterizer_;
  std::optional<LanePathFinder> lane_paths_;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_SCENE_READER_H_
