// A model that costs nothing and counts what was asked of it. If it reads vectors, its actions lie
// further ahead by the way that the target drives in a second.

#ifndef MANEUVER_TESTS_UNIT_SERVER_SERVING_FAKE_ACTION_MODEL_H_
#define MANEUVER_TESTS_UNIT_SERVER_SERVING_FAKE_ACTION_MODEL_H_

#include <condition_variable>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <new>
#include <numeric>
#include <set>
#include <vector>

#include "maneuver/v1/model.pb.h"
#include "model/inference/action_model.h"
#include "model/scene/rasterizer.h"

namespace maneuver::serving {

constexpr int kFakeActions = 3;

// What the networks were given. Shared by all sessions; safe from any thread.
class FakeNetworks {
 public:
  // Encode waits while the gate is closed.
  void CloseGate() {
    const std::lock_guard lock(mutex_);
    closed_ = true;
  }
  void OpenGate() {
    {
      const std::lock_guard lock(mutex_);
      closed_ = false;
    }
    changed_.notify_all();
  }
  // Lets one batch pass, though the gate is closed.
  void LetOnePass() {
    {
      const std::lock_guard lock(mutex_);
      ++passes_;
    }
    changed_.notify_all();
  }
  // Waits until so many batches have entered Encode.
  void AwaitBatches(size_t count) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return batches_.size() >= count; });
  }
  std::vector<int> batches() {
    const std::lock_guard lock(mutex_);
    return batches_;
  }
  int described() {
    const std::lock_guard lock(mutex_);
    return described_;
  }
  // Returns how many mean trajectories were decoded on their own.
  int means() {
    const std::lock_guard lock(mutex_);
    return means_;
  }

  // What the model says. Set them before the first call.
  Eigen::VectorXd probabilities = Eigen::Vector3d(0.2, 0.5, 0.3);
  double ahead = 0.0;       // metres that every waypoint is further along x
  int unsound_action = -1;  // its covariances are no numbers

  // Which calls throw, counted from 0, as a library does when memory is short.
  std::set<size_t> failing_batches;
  std::set<int> failing_descriptions;

  // Called when a worker gets itself an engine: after the queue, before any raster. Set it before
  // the first call.
  std::function<void()> on_new_session;

  void EnterEncode(int targets) {
    std::unique_lock lock(mutex_);
    batches_.push_back(targets);
    changed_.notify_all();
    changed_.wait(lock, [&] { return !closed_ || passes_ > 0; });
    if (closed_) --passes_;
    if (failing_batches.contains(batches_.size() - 1)) throw std::bad_alloc();
  }
  void EnterDescribe() {
    const std::lock_guard lock(mutex_);
    if (failing_descriptions.contains(described_++)) throw std::bad_alloc();
  }
  void EnterMeans(int actions) {
    const std::lock_guard lock(mutex_);
    means_ += actions;
  }

 private:
  std::mutex mutex_;  // guards what follows
  std::condition_variable changed_;
  bool closed_ = false;
  int passes_ = 0;
  std::vector<int> batches_;
  int described_ = 0;
  int means_ = 0;
};

// The sum of a raster's bytes is its feature, so an answer tells which raster it is for. Of a model
// without a raster it is the target's speed, m/s.
class FakeSession final : public inference::InferenceSession {
 public:
  explicit FakeSession(FakeNetworks& networks) : networks_(networks) {}

  void Encode(std::span<const inference::SceneInputsView> scenes,
              std::span<inference::SceneEncoding> encodings) override {
    networks_.EnterEncode(static_cast<int>(scenes.size()));
    for (size_t i = 0; i < scenes.size(); ++i) {
      encodings[i].features = Eigen::VectorXf::Constant(1, FeatureOf(scenes[i]));
      encodings[i].probabilities = networks_.probabilities;
      encodings[i].speed = scenes[i].vectors->motion.speed;
    }
  }

  std::vector<inference::ActionDistribution> Describe(const inference::SceneEncoding& encoding,
                                                      std::span<const int> actions,
                                                      inference::LatentSource) override {
    networks_.EnterDescribe();
    std::vector<inference::ActionDistribution> answers;
    for (const int action : actions) {
      inference::ActionDistribution answer;
      answer.action = action;
      // Without a scene there is no feature.
      const double feature = encoding.features.size() > 0 ? encoding.features[0] : 0.0;
      answer.latent_mean = Eigen::VectorXd::Constant(1, feature);
      answer.moment_mean = Mean(action, encoding);
      answer.sigma = {answer.moment_mean};
      answer.moment_covariance.setZero(2, 3);
      if (action == networks_.unsound_action) {
        answer.moment_covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
      }
      answers.push_back(std::move(answer));
    }
    return answers;
  }

  inference::TrajectorySet MeanTrajectories(const inference::SceneEncoding& encoding,
                                            std::span<const int> actions,
                                            inference::LatentSource) override {
    networks_.EnterMeans(static_cast<int>(actions.size()));
    inference::TrajectorySet::Rows rows(static_cast<Eigen::Index>(actions.size()), 4);
    for (size_t i = 0; i < actions.size(); ++i) {
      const inference::Trajectory mean = Mean(actions[i], encoding);
      rows.row(static_cast<Eigen::Index>(i)) = Eigen::Map<const Eigen::RowVector4d>(mean.data());
    }
    return inference::TrajectorySet(std::move(rows));
  }

  inference::Classification Classify(const inference::SceneEncoding&,
                                     const inference::Trajectory& trajectory) override {
    return {.responsibilities = Eigen::Vector3d(1.0, 0.0, 0.0),
            .log_likelihood_bound = trajectory(0, 0)};
  }

 private:
  static float FeatureOf(const inference::SceneInputsView& scene) {
    if (scene.raster == nullptr) return static_cast<float>(scene.vectors->motion.speed);
    std::vector<uint8_t> bytes(scene.raster->values());
    scene.raster->WriteInterleaved(bytes);
    return static_cast<float>(std::accumulate(bytes.begin(), bytes.end(), int64_t{0}));
  }

  // Action k stands at (k + ahead + the target's speed, k).
  inference::Trajectory Mean(int action, const inference::SceneEncoding& encoding) const {
    inference::Trajectory mean = inference::Trajectory::Constant(2, 2, action);
    mean.col(0).array() += networks_.ahead + encoding.speed;
    return mean;
  }

  FakeNetworks& networks_;
};

class FakeActionModel final : public inference::ActionModel {
 public:
  explicit FakeActionModel(FakeNetworks& networks) : networks_(networks) {
    v1::ModelSpec& spec = *manifest_.mutable_spec();
    spec.mutable_raster()->set_height(32);
    spec.mutable_raster()->set_width(32);
    spec.mutable_raster()->set_meters_per_pixel(1.0);
    spec.mutable_raster()->set_target_position(0.5);
    spec.mutable_raster()->set_history_frames(2);
    spec.mutable_raster()->mutable_frame_interval()->set_nanos(100'000'000);
    spec.mutable_trajectory()->set_waypoints(2);
    spec.mutable_trajectory()->mutable_waypoint_interval()->set_seconds(1);
    spec.set_actions(kFakeActions);
    spec.set_latent_dimensions(1);
  }

  // Returns a model that reads vectors in place of a raster.
  static std::shared_ptr<const FakeActionModel> OfVectors(FakeNetworks& networks) {
    auto model = std::make_shared<FakeActionModel>(networks);
    model->manifest_.mutable_spec()->clear_raster();
    model->manifest_.mutable_spec()->mutable_scene_vectors()->set_history_width(1);
    return model;
  }

  const v1::ModelManifest& manifest() const override { return manifest_; }
  std::string_view precision() const override { return "f32"; }
  size_t weight_bytes() const override { return 4; }
  std::unique_ptr<inference::InferenceSession> NewSession() const override {
    if (networks_.on_new_session) networks_.on_new_session();
    return std::make_unique<FakeSession>(networks_);
  }

 private:
  FakeNetworks& networks_;
  v1::ModelManifest manifest_;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_TESTS_UNIT_SERVER_SERVING_FAKE_ACTION_MODEL_H_
