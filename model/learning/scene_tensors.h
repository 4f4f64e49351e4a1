// The inputs of the networks for a batch of scenes, and the features that they compute from these.

#ifndef MANEUVER_MODEL_LEARNING_SCENE_TENSORS_H_
#define MANEUVER_MODEL_LEARNING_SCENE_TENSORS_H_

#include "model/learning/raster_batch.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Inputs of B scenes, on the CPU. Those that a spec does not use are undefined.
struct SceneTensors {
  RasterBatch rasters = {};
  at::Tensor motions = {};     // [B, scene::kMotionInputs]
  at::Tensor histories = {};   // [B, scene::kHistoryInputs]
  at::Tensor lane_paths = {};  // [B, scene::kMostLanePaths, scene::kLanePathInputs]
  at::Tensor path_mask = {};   // [B, scene::kMostLanePaths] 1 where there is a path, else 0
  at::Tensor agents = {};      // [B, scene::kMostNearAgents, scene::kAgentInputs]
  at::Tensor agent_mask = {};  // [B, scene::kMostNearAgents] 1 for an agent that is read, else 0
  at::Tensor references = {};  // r(m), [B, 2T] metres, target frame; 0 for a model without one
  at::Tensor speeds = {};      // along the heading, [B] m/s
};

// The features of B scenes that p(y|s), q(z|y,s) and the other networks read.
struct SceneFeatures {
  at::Tensor features;       // [B, F'], see artifact::SceneFeatureCount
  at::Tensor geometry = {};  // h_y, [B, K, A]; undefined unless actions look at the lanes

  int64_t size() const { return features.size(0); }
  SceneFeatures Slice(int64_t begin, int64_t end) const {
    return {features.slice(0, begin, end),
            geometry.defined() ? geometry.slice(0, begin, end) : at::Tensor()};
  }
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_SCENE_TENSORS_H_
