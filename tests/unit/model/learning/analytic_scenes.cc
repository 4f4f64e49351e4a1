#include "tests/unit/model/learning/analytic_scenes.h"

#include <cmath>
#include <functional>

#include "model/artifact/training_presets.h"

namespace maneuver::learning {
namespace {

struct ArcPoint {
  double x, y, heading;
};

ArcPoint OnArc(double curvature, double distance) {
  const double heading = curvature * distance;
  if (std::abs(curvature) < 1e-9) return {distance, 0.0, 0.0};
  return {std::sin(heading) / curvature, (1.0 - std::cos(heading)) / curvature, heading};
}

constexpr double kForkDistance = 16.0;  // metres from the start

// Straight on up to the fork, then an arc.
ArcPoint OnFork(double curvature, double distance) {
  if (distance <= kForkDistance) return {distance, 0.0, 0.0};
  ArcPoint point = OnArc(curvature, distance - kForkDistance);
  point.x += kForkDistance;
  return point;
}

using Path = std::function<ArcPoint(double distance)>;

// A vehicle along `path` from 0 on at a constant speed, m/s, for so many seconds at 10 Hz.
v1::Scenario Drive(const std::string& id, const Path& path, double speed, double duration = 8.0) {
  v1::Scenario scenario;
  scenario.set_scenario_id(id);
  scenario.set_prediction_time(1.0);
  scenario.add_target_ids(1);
  v1::Agent& agent = *scenario.add_agents();
  agent.set_id(1);
  agent.set_type(v1::AGENT_TYPE_VEHICLE);
  agent.set_length(4.5);
  agent.set_width(1.9);
  const auto steps = static_cast<int>(std::lround(10.0 * duration));
  for (int i = 0; i <= steps; ++i) {
    const double time = 0.1 * i;
    const ArcPoint point = path(speed * time);
    v1::AgentState& state = *agent.add_states();
    state.set_time(time);
    state.set_x(point.x);
    state.set_y(point.y);
    state.set_heading(static_cast<float>(point.heading));
    state.set_velocity_x(static_cast<float>(speed * std::cos(point.heading)));
    state.set_velocity_y(static_cast<float>(speed * std::sin(point.heading)));
  }
  return scenario;
}

void AddLane(const Path& path, v1::Scenario* scenario) {
  v1::MapFeature& lane = *scenario->add_map_features();
  lane.set_id(scenario->map_features_size());
  lane.set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  for (double distance = -20.0; distance <= 120.0; distance += 2.0) {
    const ArcPoint point = path(distance);
    lane.add_x(point.x);
    lane.add_y(point.y);
  }
}

}  // namespace

v1::Scenario ArcRecording(const std::string& id, double curvature, double speed, double duration) {
  const Path path = [curvature](double distance) { return OnArc(curvature, distance); };
  v1::Scenario scenario = Drive(id, path, speed, duration);
  AddLane(path, &scenario);
  return scenario;
}

v1::Scenario ForkRecording(const std::string& id, Fork lanes, bool turns_left, double curvature) {
  constexpr double kSpeed = 8.0;
  const Path left = [curvature](double distance) { return OnFork(curvature, distance); };
  const Path right = [curvature](double distance) { return OnFork(-curvature, distance); };
  v1::Scenario scenario = Drive(id, turns_left ? left : right, kSpeed);
  if (lanes != Fork::kRight) AddLane(left, &scenario);
  if (lanes != Fork::kLeft) AddLane(right, &scenario);
  return scenario;
}

std::vector<v1::Scenario> ArcRecordings(int count, double duration) {
  std::vector<v1::Scenario> recordings;
  for (int i = 0; i < count; ++i) {
    const double curvature = (i % 3 - 1) * (0.035 + 0.0005 * (i % 7));
    const double speed = (i / 3 % 2 == 0 ? 6.0 : 12.0) + 0.2 * (i % 5);
    recordings.push_back(ArcRecording("arc-" + std::to_string(i), curvature, speed, duration));
  }
  return recordings;
}

std::vector<v1::Scenario> WalkRecordings(int count) {
  constexpr int64_t kVehicle = 2;
  std::vector<v1::Scenario> recordings;
  for (int i = 0; i < count; ++i) {
    const double curvature = (i % 3 - 1) * (0.2 + 0.003 * (i % 7));
    const double speed = (i / 3 % 2 == 0 ? 0.9 : 1.6) + 0.03 * (i % 5);
    const std::string id = "walk-" + std::to_string(i);
    v1::Scenario scenario = ArcRecording(id, curvature, speed);
    v1::Agent& walker = *scenario.mutable_agents(0);
    walker.set_type(v1::AGENT_TYPE_PEDESTRIAN);
    walker.set_length(0.8);
    walker.set_width(0.8);
    v1::Agent& vehicle = *scenario.add_agents();
    vehicle = ArcRecording(id, 0.0, 8.0).agents(0);
    vehicle.set_id(kVehicle);
    for (v1::AgentState& state : *vehicle.mutable_states()) state.set_y(state.y() - 10.0);
    recordings.push_back(std::move(scenario));
  }
  return recordings;
}

std::vector<v1::Scenario> AmongPedestrians(std::vector<v1::Scenario> recordings) {
  int place = 0;
  for (v1::Scenario& recording : recordings) {
    for (int i = 0; i < place % 16; ++i) {
      v1::Agent& walker = *recording.add_agents();
      walker.set_id(10 + i);
      walker.set_type(v1::AGENT_TYPE_PEDESTRIAN);
      walker.set_length(0.6 + 0.02 * i);
      walker.set_width(0.7);
      const double direction = 0.7 * (place + i);
      const auto velocity_x = static_cast<float>(1.3 * std::cos(direction));
      const auto velocity_y = static_cast<float>(1.3 * std::sin(direction));
      for (const v1::AgentState& seen : recording.agents(0).states()) {
        v1::AgentState& state = *walker.add_states();
        state.set_time(seen.time());
        state.set_x(3.0 * i - 5.0 + velocity_x * seen.time());
        state.set_y((i % 2 == 0 ? 4.0 : -6.0) + velocity_y * seen.time());
        state.set_heading(static_cast<float>(direction));
        state.set_velocity_x(velocity_x);
        state.set_velocity_y(velocity_y);
      }
    }
    ++place;
  }
  return recordings;
}

v1::TrainingSettings TinySettings() {
  v1::TrainingSettings settings;
  v1::ModelSpec& model = *settings.mutable_model();
  model.mutable_raster()->set_height(32);
  model.mutable_raster()->set_width(32);
  model.mutable_raster()->set_meters_per_pixel(2.0);
  model.mutable_raster()->set_history_frames(2);
  model.mutable_raster()->mutable_frame_interval()->set_nanos(500'000'000);
  for (const int channels : {8, 16, 16}) {
    v1::ConvolutionSpec& convolution = *model.mutable_backbone()->add_convolutions();
    convolution.set_channels(channels);
    convolution.set_stride(2);
  }
  model.mutable_backbone()->set_features(32);
  model.mutable_trajectory()->set_waypoints(10);
  model.mutable_trajectory()->mutable_waypoint_interval()->set_nanos(300'000'000);
  model.set_actions(6);
  model.set_latent_dimensions(3);
  for (v1::MlpSpec* mlp : {model.mutable_action_predictor(), model.mutable_trajectory_encoder(),
                           model.mutable_decoder(), model.mutable_scenario_encoder()}) {
    mlp->add_hidden(32);
    mlp->add_hidden(24);
  }
  settings.mutable_examples()->mutable_stride()->set_nanos(500'000'000);
  settings.mutable_examples()->set_validation_share(0.25);
  v1::OptimizationSettings& optimization = *settings.mutable_optimization();
  optimization.set_pretraining_epochs(25);
  optimization.set_mixture_epochs(10);
  optimization.set_joint_epochs(15);
  optimization.set_posterior_epochs(2);
  optimization.set_batch_size(16);
  optimization.set_learning_rate(3e-3);
  settings.set_seed(7);
  settings.set_threads(1);
  return artifact::ResolveTrainingSettings(settings);
}

v1::TrainingSettings TinyLanesSettings(const std::string& preset) {
  v1::TrainingSettings settings = TinySettings();
  settings.set_preset(preset);
  v1::ModelSpec& model = *settings.mutable_model();
  model.clear_raster();
  model.clear_backbone();
  model.clear_target_motion();
  v1::SceneVectorsSpec& vectors = *model.mutable_scene_vectors();
  vectors.set_history_width(16);
  vectors.set_path_width(24);
  vectors.set_attention_heads(2);
  vectors.set_features(32);
  vectors.set_agent_width(12);
  vectors.set_agent_heads(3);
  v1::ActionGeometrySpec& geometry = *model.mutable_action_geometry();
  geometry.set_pair_width(12);
  geometry.set_attention_heads(2);
  geometry.set_features(16);
  v1::OptimizationSettings optimization;
  optimization.set_pretraining_epochs(25);
  optimization.set_mixture_epochs(10);
  optimization.set_joint_epochs(15);
  optimization.set_covariance_epochs(3);
  optimization.set_batch_size(16);
  optimization.set_learning_rate(3e-3);
  *settings.mutable_optimization() = optimization;
  v1::ExampleSettings examples;
  examples.set_validation_share(0.25);
  *settings.mutable_examples() = examples;
  settings.clear_augmentation();
  return artifact::ResolveTrainingSettings(settings);
}

}  // namespace maneuver::learning
