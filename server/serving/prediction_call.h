// One caller's question about some targets, on its way through the queue and the workers.

#ifndef MANEUVER_SERVER_SERVING_PREDICTION_CALL_H_
#define MANEUVER_SERVER_SERVING_PREDICTION_CALL_H_

#include <Eigen/Core>
#include <atomic>
#include <chrono>
#include <functional>
#include <optional>
#include <span>
#include <variant>
#include <vector>

#include "absl/status/status.h"
#include "model/inference/action_model.h"
#include "model/inference/joint_combinations.h"
#include "model/inference/representatives.h"
#include "model/scene/pose2.h"
#include "model/scene/road_map.h"
#include "model/scene/scene_reader.h"
#include "server/serving/served_model.h"

namespace maneuver::v1 {
class Scenario;
}

namespace maneuver::serving {

using TimePoint = std::chrono::steady_clock::time_point;

// Which actions to describe, by p(y|s).
struct AtLeast {
  double probability = 0.05;
};
struct TopK {
  int k = 1;
};
struct ActionIds {
  std::vector<int> ids;  // each 0 .. K-1, once
};
using ActionSelection = std::variant<AtLeast, TopK, ActionIds>;

// Returns the selected actions, most probable first. Among equally probable ones the smaller id
// comes first. Leaves out actions whose probability is NaN.
std::vector<int> SelectActions(const Eigen::VectorXd& probabilities,
                               const ActionSelection& selection);

// What to compute for each target, beside p(y|s).
struct DescribeActions {
  ActionSelection selection = {};
  inference::LatentSource source = inference::LatentSource::kPosterior;
  int representatives = 0;  // how many to choose, 0 .. K; they are described as well
  // How many combinations of the actions of a scenario's targets to find, 0 .. 64; their actions
  // are described as well.
  int combinations = 0;
};
struct ClassifyTrajectory {};
using Question = std::variant<std::monostate, DescribeActions, ClassifyTrajectory>;

// Whose work goes first; see TargetQueue.
enum class Priority { kInteractive = 0, kBulk = 1 };

// One target, validated.
struct Target {
  const v1::Scenario* scenario = nullptr;  // outlives the call
  int64_t id = 0;
  scene::Pose2 X_WT;
  // The trajectory that was driven, [T, 2] metres, target frame; only for ClassifyTrajectory.
  inference::Trajectory trajectory = {};
  // The indexed map: the one that the scenario names, or its own. Outlives the call. nullptr: the
  // scenario's own map, searched for each target.
  const scene::RoadMap* map = nullptr;
};

// Read what a model needs of a target: the raster and motion, the scene vectors, or both
// (SceneReader::Read). `reader` and `inputs` must have the model's spec.
void ReadRaster(const Target& target, scene::SceneReader& reader, scene::SceneInputs* inputs);
void ReadVectors(const Target& target, scene::SceneReader& reader, scene::SceneInputs* inputs);
void ReadScene(const Target& target, scene::SceneReader& reader, scene::SceneInputs* inputs);

struct TargetAnswer {
  absl::Status status;  // if not OK, nothing else is set
  inference::SceneEncoding encoding;
  std::vector<inference::ActionDistribution> distributions;  // most probable first
  std::vector<inference::Representative> representatives;    // the medoid first
  // What CombineTargets needs of it, if combinations are asked for: actions and their trajectories.
  inference::JointTarget joint;
  std::optional<inference::Classification> classification;
};

// The targets of one scenario: PredictionCall::targets[begin .. end - 1].
struct TargetRange {
  size_t begin = 0;
  size_t end = 0;
};

// The combinations of those targets of one scenario that have no error.
struct JointAnswer {
  std::vector<size_t> targets;  // indices of PredictionCall::targets, ascending
  inference::JointCombinations found;
};

// Describes the requested actions in a scene, chooses the representatives, and finds the
// trajectories that joint_answer.h combines.
//   waypoint_interval: seconds between the waypoints of the session's model
//   answer: receives distributions, representatives, and the trajectories of `joint`
void DescribeTarget(const DescribeActions& question, const inference::SceneEncoding& encoding,
                    double waypoint_interval, inference::InferenceSession& session,
                    TargetAnswer* answer);

// The caller fills in a call and submits it to the scheduler, which answers it once.
struct PredictionCall {
  ModelHandle model;
  Question question;
  std::vector<Target> targets;  // at least one
  int64_t bytes = 0;            // of the request that it keeps in memory
  Priority priority = Priority::kInteractive;
  TimePoint deadline = TimePoint::max();
  // Called once, when each target has an answer or an error: on a worker, or on a thread that
  // submits another call or destroys the scheduler.
  //   answers: in the order of targets.
  std::function<void(std::vector<TargetAnswer> answers)> done;

  // Set, from any thread, when the caller has gone.
  std::atomic<bool> cancelled = false;

  // Returns OK while somebody waits for the answer, else CANCELLED or DEADLINE_EXCEEDED.
  absl::Status CheckWanted(TimePoint now) const;

  // The combinations of each scenario of `targets`, in their order, if `question` asks for some.
  // Complete when `done` is called.
  std::vector<JointAnswer> joint;

  // Used only by the scheduler.
  struct JointSet {
    TargetRange range;
    std::atomic<size_t> unanswered = 0;  // of its targets
  };
  std::vector<JointSet> joint_sets;  // one for each of `joint`
  std::vector<TargetAnswer> answers;
  std::atomic<size_t> unanswered = 0;
  size_t next = 0;      // first target that no worker has taken; guarded by the scheduler
  TimePoint submitted;  // when it entered the queue
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_PREDICTION_CALL_H_
