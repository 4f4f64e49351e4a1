#ifndef MANEUVER_MODEL_ARTIFACT_TENSOR_H_
#define MANEUVER_MODEL_ARTIFACT_TENSOR_H_

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace maneuver::artifact {

// A dense row-major array of 32-bit floats.
struct Tensor {
  std::vector<int64_t> shape;
  std::vector<float> values;  // as many as the product of shape
};

// Tensors by name. The following are the names of a model's weights and their shapes, in PyTorch's
// conventions. C_in, h, w are those of the layer's input; flattening is channel-major, [C, h, w]:
//
//   backbone.convolution.{i}.weight   [C_out, C_in, 3, 3]   no bias: batch normalisation follows
//   backbone.normalization.{i}.{weight,bias,running_mean,running_var}   [C_out], epsilon 1e-5
//   a residual backbone has instead, each convolution.weight with such a normalization:
//     backbone.stem.convolution, backbone.stage.{s}.block.{b}.convolution.{i} and, where a block's
//     input and output differ in size, backbone.stage.{s}.block.{b}.shortcut.convolution
//   backbone.projection.{weight,bias}   [F, C * h * w], [F]   on the flattened last grid; then ReLU
//   action_predictor.{i}.{weight,bias}   [out, in], [out]   F' -> hidden ... -> K logits; F' is F
//       features, then the target's motion if the spec has it (scene/target_motion.h)
//   trajectory_encoder.{i}.{weight,bias}   2T -> hidden ... -> 2D: mean, then log-variance
//   decoder.{i}.{weight,bias}   D -> hidden ... -> 2T
//   scenario_encoder.{i}.{weight,bias}   [K, out, in], [K, out]   F' -> hidden ... -> 2D: a, b;
//       q(z|y=k,s) has mean mu_k + sigma_k * a and log-variance logvar_k + b: relative to component
//       k of the mixture, so that an untrained encoder gives the generic action
//   mixture.mean, mixture.log_variance   [K, D]
//   mixture.log_weight   [K]   ln p(y) without a scenario, normalised
//   trajectory.mean, trajectory.stddev   [T, 2]   metres: the encoder reads (x - mean) / stddev;
//       the decoder's output times stddev plus mean is in metres
//   decoder.covariance   [K, T, 3]   xx, xy, yy, square metres, target frame: what p(x|z) adds to
//       the latent covariance of action k at each waypoint, in moments
//   or instead, if the spec has it, a function of the mean of the latent:
//   decoder_covariance.{i}.{weight,bias}   D -> hidden ... -> 3T: a, b, c of each waypoint, whose
//       covariance is L L^T with L = (e^a 0; c e^b e^b), a and b clamped to the bounds below
//
// For a model with scene vectors (scene/scene_vectors.h), instead of the backbone or beside it. H,
// P, Q and F are the spec's history_width, path_width, agent_width and features. All arrows pass
// through ReLU:
//
//   history.{0,1}.{weight,bias}   42 -> H -> H: o, from the target's own history
//   lane_path.{0,1}.{weight,bias}   84 -> P -> P, no ReLU after the second: one lane path alone
//   lane_path.history.{weight,bias}   H -> P: what o adds to each path, before the ReLU
//   lane_path.output.{weight,bias}   P -> P: l_i, for path i
//   lane_path.attention.{weight,bias}   P -> heads, no ReLU. Head j weights channels j P / heads to
//       (j + 1) P / heads of all l_i by the softmax of its number over the paths: attended [P]. The
//       largest value of each channel over the paths: maximum [P]. Both are 0 without paths
//   agent.{0,1,history,output,attention}.{weight,bias}   the same for nearby agents
//       (scene/agent_inputs.h): 24 numbers for 84, Q for P, the spec's agent_heads for heads
//   join.{weight,bias}   (o, attended and maximum of the lane paths, those of the agents, then the
//       backbone's features, whichever exist) -> F: the scene's features f
//
// For actions that look at the lanes. G, A = pair_width, features of the spec's action_geometry;
// u_yi are the 18 numbers of action y and path i, v_y the 13 of action y
// (scene/action_geometry.h):
//
//   action_geometry.pair.weight   [G, 18]
//   action_geometry.path.weight   [G, P]
//   action_geometry.scene.weight   [G, F]
//   action_geometry.action.bias   [K, G]
//       g_yi = relu(pair u_yi + path l_i + scene f + action_y)
//   action_geometry.hidden.{weight,bias}   g_yi -> G
//   action_geometry.attention.{weight,bias}   G -> heads; attended and maximum over i as above
//   action_geometry.joint.weight   [A, 2G + 13] of (attended, maximum, v_y)
//   action_geometry.joint_scene.weight   [A, F]
//   action_geometry.joint_action.bias   [K, A]
//       relu of the sum of the three
//   action_geometry.output.{weight,bias}   A -> A: h_y
//   action_geometry.logit.weight   [1, A]: what h_y adds to the logit of action y
//   action_geometry.latent.weight   [K, 2D, A]: what h_y adds to the output of scenario_encoder y
//
// For a mean that depends on the scene, with M functions per axis (CurveFunctions, model_spec.h):
//
//   mean_residual.scene.weight   [K, 2M, F]
//   mean_residual.geometry.weight   [K, 2M, A]; only for actions that look at the lanes
//   mean_residual.curves   [2T, 2M] metres: p(x|z,y,s) has the decoder's mean plus
//       curves (scene_y f + geometry_y h_y)
//
// For a covariance that the scene predicts, instead of decoder.covariance:
//
//   scene_covariance.{i}.{weight,bias}   [K, out, in], [K, out]   F -> hidden ... -> 8: for each of
//       along and across, four numbers a_0 .. a_3; ln stddev at time t of the horizon h is
//       a_0 + a_1 ln(2t/h) + a_2 (2t/h - 1) + a_3 e^-t, clamped to the bounds below. Along and
//       across are those of the predicted mean (inference/mean_direction.h)
//   scene_covariance.speed_factor   [6, 2]   factors of the two variances by the speed at the
//       prediction time: below 0.5, 2, 5, 10, 15 m/s and from there on
//
// A trajectory [T, 2] is flattened as x_1, y_1, x_2, y_2, ... Trajectories that the encoder reads
// and the decoder outputs are relative to the spec's reference (scene/motion_reference.h).
using TensorMap = std::map<std::string, Tensor>;

// Bounds of a and b of decoder_covariance, and of scene_covariance: 5 cm and 55 m.
inline constexpr float kLeastLogStddev = -3.0f;
inline constexpr float kMostLogStddev = 4.0f;

// For scene_covariance: numbers per axis, and the lower bounds of all speed bins except the first,
// m/s.
inline constexpr int kStddevTerms = 4;
inline constexpr double kSpeedBins[] = {0.5, 2.0, 5.0, 10.0, 15.0};
inline constexpr int kSpeedBinCount = 6;

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_TENSOR_H_
