// Exports a model's networks as an ONNX file for other engines. The file computes what this engine
// computes from a scene's inputs (scene/scene_reader.h).
//
// Inputs for N scenes. An input exists if the model reads it:
//   raster          [N, C, H, W]  scene::Rasterizer's bytes divided by 255, channels first
//   motion          [N, 4]        scene::MotionInputs
//   history         [N, 42]       scene::HistoryInputs
//   lane_paths      [N, 6, 84]    scene::LanePathInputs::values; 0 where there is no path
//   lane_path_mask  [N, 6]        1 where there is a path, else 0
//   agents          [N, 12, 24]   scene::AgentInputs::values; 0 where there is no agent
//   agent_mask      [N, 12]       1 where there is an agent, else 0
//   action_paths    [N, K, 6, 18] each action relative to each path; 0 where there is no path
//   action_numbers  [N, K, 13]    of each action's own trajectory
//   reference       [N, T, 2]     r(m), target frame, metres (scene/motion_reference.h); only with
//                                 distributions
// Outputs:
//   features        [N, F']       artifact::SceneFeatureCount
//   probabilities   [N, K]        p(y|s)
//   generic_trajectories [K, T, 2]  p(z|y) decoded at its mean, metres, without the reference.
//                                 Depends on no input. Only for actions that look at the lanes
// and, with distributions:
//   latent_mean     [N, K, D]     of q(z|y,s)
//   latent_stddev   [N, K, D]
//   trajectories    [N, K, 2D+1, T, 2]  sigma trajectories, target frame, metres, in the order of
//                                 inference::ActionDistribution::sigma, with the residual of the
//                                 mean and the reference
//
// Callers compute action_paths and action_numbers from the other inputs. For each scene:
//   1. Add the reference, 0 if the model has none, to each of the generic_trajectories.
//   2. Pick the points of each that scene::FindGeometryWaypoints names; -1 stands for the origin.
//   3. Give them to scene::DescribeActions, with lane_paths, the target's speed along its heading,
//      scene::MotionEstimate::speed, and the model's inputs_version. Its formulas are in
//      scene/action_geometry.h.
//
// Metadata:
//   weights_sha256  of the model's weights, hexadecimal
//   action_names    display name of action 0 .. K-1, a JSON array of strings
//
// Batch normalisation stays a node of its own, as it was learned. Not in the file: how a scene is
// read, moments and their covariances (closed forms of the sigma trajectories and of small tables
// or networks), the prior p(z|y), and q(z|x), which classifies trajectories.

#ifndef MANEUVER_MODEL_ONNX_ONNX_EXPORT_H_
#define MANEUVER_MODEL_ONNX_ONNX_EXPORT_H_

#include <string>

#include "model/artifact/model_folder.h"

namespace maneuver::onnx {

struct OnnxOptions {
  bool distributions = true;
  int scenes = 0;  // N, for engines that need it fixed; 0: any number
};

// Returns the bytes of the file. `model` is as artifact::ReadModelFolder returns it.
std::string ExportOnnx(const artifact::StoredModel& model, const OnnxOptions& options);

}  // namespace maneuver::onnx

#endif  // MANEUVER_MODEL_ONNX_ONNX_EXPORT_H_
