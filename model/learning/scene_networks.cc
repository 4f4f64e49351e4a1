// The part of Networks that reads scenes: backbone, history, lane paths, agents, and how actions
// lie to the lanes.

#include <ATen/Parallel.h>

#include "model/artifact/model_spec.h"
#include "model/learning/networks.h"
#include "model/scene/lane_path_inputs.h"

namespace maneuver::learning {
namespace {

using scene::kActionNumbers;
using scene::kLanePathInputs;
using scene::kMostLanePaths;
using scene::kPairNumbers;

// Far below any number that is compared: no softmax gives it a share.
constexpr double kNever = -1e4;

// What attention and the maximum take from the elements of a set. Head j of the attention weighs
// its own share of the channels.
//   elements: [..., N, C];  scores: [..., N, heads];  mask: 1 or 0, broadcasts to [..., N]
//   returns: [..., 2C], 0 where the mask is all 0
at::Tensor Pool(const at::Tensor& elements, const at::Tensor& scores, const at::Tensor& mask) {
  const int64_t heads = scores.size(-1);
  const at::Tensor there = mask.unsqueeze(-1);  // [..., N, 1]
  const at::Tensor weights = scores.masked_fill(there == 0, kNever).softmax(-2) * there;
  const at::Tensor by_head =
      elements.unflatten(-1, {heads, elements.size(-1) / heads});  // [..., N, heads, C / heads]
  const at::Tensor attended = (weights.unsqueeze(-1) * by_head).sum(-3).flatten(-2);
  // Elements are not negative, after a ReLU: 0 is the maximum of none.
  const at::Tensor maximum = (elements * there).amax(-2);
  return at::cat({attended, maximum}, -1);
}

// Positions of the generic actions at the times that geometry looks at.
//   trajectories: [B, K, T, 2] metres
//   returns: [B, K, times, 2 (at, before), 2]
at::Tensor GeometryPoints(const at::Tensor& trajectories,
                          const scene::GeometryWaypoints& waypoints) {
  std::vector<at::Tensor> points;
  for (int i = 0; i < scene::kGeometryTimes; ++i) {
    const auto time = static_cast<size_t>(i);
    const at::Tensor at = trajectories.select(2, waypoints.at[time]);
    const at::Tensor before = waypoints.before[time] < 0
                                  ? at::zeros_like(at)
                                  : trajectories.select(2, waypoints.before[time]);
    points.push_back(at::stack({at, before}, 2));
  }
  return at::stack(points, 2).contiguous();
}

}  // namespace

at::Tensor Networks::Dense(const std::string& name, const at::Tensor& x) const {
  return at::linear(x, (*this)[name + ".weight"], (*this)[name + ".bias"]);
}

at::Tensor Networks::Drop(const at::Tensor& values, double share, at::Generator& generator) const {
  const at::Tensor kept =
      at::empty(values.sizes(), at::kFloat).bernoulli_(1.0 - share, generator).div_(1.0 - share);
  return values * kept.to(device_);
}

at::Tensor Networks::ReadScenes(const SceneTensors& scenes, const Mode& mode,
                                at::Tensor* lane_paths) {
  at::Tensor raster;
  if (spec_.has_raster()) {
    const at::Tensor grid = EvaluateBackbone(scenes.rasters, mode.training != nullptr);
    raster = Dense("backbone.projection", grid.contiguous().flatten(1)).relu();
  }
  if (!spec_.has_scene_vectors()) return raster;
  const at::Tensor history =
      Dense("history.1", Dense("history.0", scenes.histories.to(device_)).relu()).relu();
  std::vector<at::Tensor> parts = {history};
  // Reads a set whose layers are called `name`.*; adds what is pooled of it to `parts`.
  const auto read_set = [&](const std::string& name, const at::Tensor& numbers,
                            const at::Tensor& mask) {
    const at::Tensor alone = Dense(name + ".1", Dense(name + ".0", numbers.to(device_)).relu());
    const at::Tensor elements =
        Dense(name + ".output", (alone + Dense(name + ".history", history).unsqueeze(1)).relu())
            .relu();
    parts.push_back(Pool(elements, Dense(name + ".attention", elements), mask.to(device_)));
    return elements;
  };
  if (artifact::ReadsLanePaths(spec_)) {
    *lane_paths = read_set("lane_path", scenes.lane_paths, scenes.path_mask);
  }
  if (artifact::ReadsAgents(spec_)) read_set("agent", scenes.agents, scenes.agent_mask);
  if (raster.defined()) parts.push_back(raster);
  return Dense("join", at::cat(parts, 1)).relu();
}

at::Tensor Networks::EncodeActionGeometry(const SceneTensors& scenes, const at::Tensor& lane_paths,
                                          const at::Tensor& features) const {
  const int64_t batch = features.size(0), actions = spec_.actions();
  at::Tensor pairs = at::empty({batch, actions, kMostLanePaths, kPairNumbers}, at::kFloat);
  at::Tensor numbers = at::empty({batch, actions, kActionNumbers}, at::kFloat);
  {
    at::NoGradGuard no_grad;
    const at::Tensor generic = Decode((*this)["mixture.mean"]).cpu();  // [K, 2T]
    const at::Tensor points = GeometryPoints(
        (generic + scenes.references.unsqueeze(1)).unflatten(2, {-1, 2}), geometry_waypoints_);
    static_assert(sizeof(scene::ActionPoints) == sizeof(float) * scene::kGeometryTimes * 4);
    at::parallel_for(0, batch, 16, [&](int64_t begin, int64_t end) {
      std::vector<scene::ActionPoints> of_actions(static_cast<size_t>(actions));
      scene::LanePathInputs paths;
      for (int64_t b = begin; b < end; ++b) {
        const float* point = points[b].data_ptr<float>();
        for (scene::ActionPoints& each : of_actions) {
          for (size_t i = 0; i < scene::kGeometryTimes; ++i, point += 4) {
            each.at[i] = {point[0], point[1]};
            each.before[i] = {point[2], point[3]};
          }
        }
        const float* values =
            scenes.lane_paths.data_ptr<float>() + b * static_cast<int64_t>(paths.values.size());
        std::copy(values, values + paths.values.size(), paths.values.begin());
        paths.count = static_cast<int>(scenes.path_mask[b].sum().item<float>());
        scene::DescribeActions(
            of_actions, geometry_waypoints_, paths, scenes.speeds[b].item<float>(),
            spec_.inputs_version(),
            {pairs[b].data_ptr<float>(), static_cast<size_t>(pairs[b].numel())},
            {numbers[b].data_ptr<float>(), static_cast<size_t>(numbers[b].numel())});
      }
    });
  }
  const auto linear = [this](const char* name, const at::Tensor& x) {
    return at::linear(x, (*this)[name]);
  };
  const at::Tensor of_path =
      linear("action_geometry.path.weight", lane_paths) +
      linear("action_geometry.scene.weight", features).unsqueeze(1);  // [B, paths, G]
  at::Tensor pair = linear("action_geometry.pair.weight", pairs.to(device_)) +
                    of_path.unsqueeze(1) + (*this)["action_geometry.action.bias"].unsqueeze(1);
  pair = Dense("action_geometry.hidden", pair.relu()).relu();  // [B, K, paths, G]
  const at::Tensor pooled = Pool(pair, Dense("action_geometry.attention", pair),
                                 scenes.path_mask.to(device_).unsqueeze(1));
  const at::Tensor joint =
      linear("action_geometry.joint.weight", at::cat({pooled, numbers.to(device_)}, 2)) +
      linear("action_geometry.joint_scene.weight", features).unsqueeze(1) +
      (*this)["action_geometry.joint_action.bias"];
  return Dense("action_geometry.output", joint.relu()).relu();
}

SceneFeatures Networks::EncodeScenes(const SceneTensors& scenes, const Mode& mode) {
  at::Tensor lane_paths;
  SceneFeatures encoded{ReadScenes(scenes, mode, &lane_paths)};
  if (mode.training != nullptr && mode.dropout > 0.0) {
    encoded.features = Drop(encoded.features, mode.dropout, *mode.training);
  }
  if (spec_.target_motion()) {
    encoded.features = at::cat({encoded.features, scenes.motions.to(device_)}, 1);
  }
  if (spec_.has_action_geometry()) {
    encoded.geometry = EncodeActionGeometry(scenes, lane_paths, encoded.features);
    if (mode.training != nullptr && mode.geometry_dropout > 0.0) {
      encoded.geometry = Drop(encoded.geometry, mode.geometry_dropout, *mode.training);
    }
  }
  return encoded;
}

}  // namespace maneuver::learning
