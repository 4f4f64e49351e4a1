#include "model/inference/action_network.h"

#include <algorithm>

#include "model/artifact/model_spec.h"
#include "model/inference/stored_layers.h"

namespace maneuver::inference {
namespace {

using artifact::Tensor;
using artifact::TensorMap;
using scene::kActionNumbers;
using scene::kGeometryTimes;
using scene::kMostLanePaths;
using scene::kPairNumbers;

// What the scene adds to pairs and to joints, as one layer: both read f.
DenseLayer SceneLayer(const TensorMap& weights) {
  const Tensor& pairs = weights.at("action_geometry.scene.weight");
  const Tensor& joints = weights.at("action_geometry.joint_scene.weight");
  std::vector<float> both = pairs.values;
  both.insert(both.end(), joints.values.begin(), joints.values.end());
  const int64_t outputs = pairs.shape[0] + joints.shape[0];
  const std::vector<float> zeros(static_cast<size_t>(outputs));
  return DenseLayer(static_cast<int>(pairs.shape[1]), static_cast<int>(outputs), both.data(),
                    zeros.data());
}

auto Rows(const Tensor& tensor) {
  return Eigen::Map<const Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
      tensor.values.data(), tensor.shape[0], tensor.shape[1]);
}

}  // namespace

ActionNetwork::ActionNetwork(const v1::ModelSpec& spec, const TensorMap& weights,
                             const TrajectorySet::Rows& generic)
    : waypoints_(scene::FindGeometryWaypoints(artifact::WaypointTimes(spec.trajectory()))),
      inputs_version_(spec.inputs_version()),
      shape_{spec.action_geometry().pair_width(), spec.action_geometry().attention_heads()},
      pair_(StoredLayerWithoutBias(weights, "action_geometry.pair")),
      path_(StoredLayerWithoutBias(weights, "action_geometry.path")),
      scene_(SceneLayer(weights)),
      action_bias_(Rows(weights.at("action_geometry.action.bias"))),
      hidden_(StoredLayer(weights, "action_geometry.hidden", false)),
      attention_(StoredLayer(weights, "action_geometry.attention", false)),
      joint_(StoredLayerWithoutBias(weights, "action_geometry.joint")),
      joint_bias_(Rows(weights.at("action_geometry.joint_action.bias"))),
      output_(StoredLayer(weights, "action_geometry.output", false)),
      logit_(StoredLayerWithoutBias(weights, "action_geometry.logit")) {
  for (int k = 0; k < spec.actions(); ++k) {
    latent_.push_back(StoredLayerWithoutBias(weights, "action_geometry.latent", k));
    scene::ActionPoints& points = generic_.emplace_back();
    for (int t = 0; t < kGeometryTimes; ++t) {
      for (int axis = 0; axis < 2; ++axis) {
        const auto at = [&](int waypoint) {
          return waypoint < 0 ? 0.0f : static_cast<float>(generic(k, 2 * waypoint + axis));
        };
        points.at[t][axis] = at(waypoints_.at[t]);
        points.before[t][axis] = at(waypoints_.before[t]);
      }
    }
  }
}

size_t ActionNetwork::bytes() const {
  size_t bytes = 0;
  for (const DenseLayer* layer :
       {&pair_, &path_, &scene_, &hidden_, &attention_, &joint_, &output_, &logit_}) {
    bytes += layer->bytes();
  }
  for (const DenseLayer& layer : latent_) bytes += layer.bytes();
  return bytes;
}

void ActionNetwork::Evaluate(std::span<const scene::SceneVectors* const> scenes,
                             std::span<const Trajectory* const> references,
                             const SceneVectorFeatures& inputs, ActionFeatures* output) const {
  const size_t actions = generic_.size();
  const size_t features = static_cast<size_t>(output_.outputs());
  const int paths = inputs.paths.first.back();
  output->scene_terms.resize(scenes.size() * static_cast<size_t>(scene_.outputs()));
  scene_.Apply(inputs.features.data(), static_cast<int>(scenes.size()), Activation::kNone,
               &output->dense, output->scene_terms.data());
  output->path_terms.resize(static_cast<size_t>(paths) * static_cast<size_t>(shape_.width));
  path_.Apply(inputs.paths.elements.data(), paths, Activation::kNone, &output->dense,
              output->path_terms.data());
  output->geometry.resize(scenes.size() * actions * features);
  for (size_t s = 0; s < scenes.size(); ++s) {
    EvaluateScene(*scenes[s], *references[s],
                  output->scene_terms.data() + s * static_cast<size_t>(scene_.outputs()),
                  output->path_terms.data() + Eigen::Index{inputs.paths.first[s]} * shape_.width,
                  output, output->geometry.data() + s * actions * features);
  }
  output->logits.resize(scenes.size() * actions);
  logit_.Apply(output->geometry.data(), static_cast<int>(scenes.size() * actions),
               Activation::kNone, &output->dense, output->logits.data());
}

void ActionNetwork::EvaluateScene(const scene::SceneVectors& scene, const Trajectory& reference,
                                  const float* scene_terms, const float* path_terms,
                                  ActionFeatures* scratch, float* geometry) const {
  const size_t actions = generic_.size();
  const int paths = scene.paths.count;
  PlaceActions(reference, &scratch->points);
  scratch->all_pairs.resize(actions * kMostLanePaths * kPairNumbers);
  scratch->actions.resize(actions * kActionNumbers);
  scene::DescribeActions(scratch->points, waypoints_, scene.paths, scene.motion.speed,
                         inputs_version_, scratch->all_pairs, scratch->actions);
  EvaluatePairs(paths, scene_terms, path_terms, scratch);

  const size_t inputs = static_cast<size_t>(joint_.inputs());
  const size_t pooled = inputs - kActionNumbers;
  scratch->joined.resize(actions * inputs);
  for (size_t k = 0; k < actions; ++k) {
    float* row = scratch->joined.data() + k * inputs;
    const Eigen::Index first = static_cast<Eigen::Index>(k) * paths;
    kernels::PoolSet(scratch->second.data() + first * shape_.width,
                     scratch->scores.data() + first * shape_.heads, paths, shape_, row);
    std::copy_n(scratch->actions.data() + k * kActionNumbers, kActionNumbers, row + pooled);
  }
  const int rows = static_cast<int>(actions);
  scratch->joint.resize(actions * static_cast<size_t>(joint_.outputs()));
  joint_.Apply(scratch->joined.data(), rows, Activation::kNone, &scratch->dense,
               scratch->joint.data());
  float* row = scratch->joint.data();
  for (Eigen::Index k = 0; k < rows; ++k, row += joint_.outputs()) {
    kernels::AddTwoAndRectify(joint_bias_.row(k).data(), scene_terms + shape_.width,
                              joint_.outputs(), row);
  }
  output_.Apply(scratch->joint.data(), rows, Activation::kRelu, &scratch->dense, geometry);
}

void ActionNetwork::PlaceActions(const Trajectory& reference,
                                 std::vector<scene::ActionPoints>* points) const {
  *points = generic_;
  if (reference.rows() == 0) return;
  for (int t = 0; t < kGeometryTimes; ++t) {
    for (int axis = 0; axis < 2; ++axis) {
      const int before_waypoint = waypoints_.before[t];
      const auto at = static_cast<float>(reference(waypoints_.at[t], axis));
      const auto before =
          before_waypoint < 0 ? 0.0f : static_cast<float>(reference(before_waypoint, axis));
      for (scene::ActionPoints& action : *points) {
        action.at[t][axis] += at;
        action.before[t][axis] += before;
      }
    }
  }
}

void ActionNetwork::EvaluatePairs(int paths, const float* scene_terms, const float* path_terms,
                                  ActionFeatures* scratch) const {
  const size_t actions = generic_.size();
  const size_t rows = actions * static_cast<size_t>(paths);
  // Paths that are not there are left out.
  const size_t numbers = static_cast<size_t>(paths) * kPairNumbers;
  scratch->pairs.resize(actions * numbers);
  for (size_t k = 0; k < actions; ++k) {
    std::copy_n(scratch->all_pairs.data() + k * kMostLanePaths * kPairNumbers, numbers,
                scratch->pairs.data() + k * numbers);
  }
  const size_t size = rows * static_cast<size_t>(shape_.width);
  scratch->first.resize(size);
  scratch->second.resize(size);
  scratch->scores.resize(rows * static_cast<size_t>(shape_.heads));
  pair_.Apply(scratch->pairs.data(), static_cast<int>(rows), Activation::kNone, &scratch->dense,
              scratch->first.data());
  const Eigen::Map<const Eigen::RowVectorXf> of_scene(scene_terms, shape_.width);
  scratch->action_terms = action_bias_.rowwise() + of_scene.array();
  float* row = scratch->first.data();
  for (Eigen::Index k = 0; k < static_cast<Eigen::Index>(actions); ++k) {
    for (int p = 0; p < paths; ++p, row += shape_.width) {
      kernels::AddTwoAndRectify(path_terms + Eigen::Index{p} * shape_.width,
                                scratch->action_terms.row(k).data(), shape_.width, row);
    }
  }
  hidden_.Apply(scratch->first.data(), static_cast<int>(rows), Activation::kRelu, &scratch->dense,
                scratch->second.data());
  attention_.Apply(scratch->second.data(), static_cast<int>(rows), Activation::kNone,
                   &scratch->dense, scratch->scores.data());
}

void ActionNetwork::AddLatent(int k, const float* geometry, DenseScratch* scratch,
                              Eigen::VectorXf* outputs) const {
  Eigen::VectorXf terms(outputs->size());
  latent_[static_cast<size_t>(k)].Apply(geometry, 1, Activation::kNone, scratch, terms.data());
  *outputs += terms;
}

}  // namespace maneuver::inference
