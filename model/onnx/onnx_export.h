// A model's networks as an ONNX file, for other engines: what this one computes, from the raster
// on.
//
// Inputs, N scenes:
//   raster        [N, C, H, W]  scene::Rasterizer's bytes divided by 255, channels first
//   motion        [N, 4]        scene::MotionInputs; of a model that asks for it alone
// Outputs:
//   features      [N, F']       artifact::SceneFeatures
//   probabilities [N, K]        p(y|s)
// and, with distributions,
//   latent_mean   [N, K, D]     of q(z|y,s)
//   latent_stddev [N, K, D]
//   trajectories  [N, K, 2D+1, T, 2]  sigma trajectories, target frame, metres, in the order of
//                               inference::ActionDistribution::sigma
//
// Batch normalisation stays a node of its own, as it was learned. Not in the file: drawing, moments
// and their covariances (closed forms of the sigma trajectories and of two small tables), the prior
// p(z|y), and q(z|x), which classifies trajectories.

#ifndef MANEUVER_MODEL_ONNX_ONNX_EXPORT_H_
#define MANEUVER_MODEL_ONNX_ONNX_EXPORT_H_

#include <string>

#include "model/artifact/model_folder.h"

namespace maneuver::onnx {

struct ExportOptions {
  bool distributions = true;
  int scenes = 0;  // N, for engines that want to know it; 0: any number
};

// The bytes of the file, of a model as artifact::ReadModelFolder returns it.
std::string ExportOnnx(const artifact::StoredModel& model, const ExportOptions& options);

}  // namespace maneuver::onnx

#endif  // MANEUVER_MODEL_ONNX_ONNX_EXPORT_H_
