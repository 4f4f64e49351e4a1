// The interface that answers queries: a loaded model version, and sessions that evaluate it.

#ifndef MANEUVER_MODEL_INFERENCE_ACTION_MODEL_H_
#define MANEUVER_MODEL_INFERENCE_ACTION_MODEL_H_

#include <Eigen/Core>
#include <filesystem>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/model.pb.h"
#include "model/inference/trajectory_set.h"
#include "model/scene/raster.h"
#include "model/scene/scene_reader.h"
#include "model/scene/scene_vectors.h"
#include "model/scene/target_motion.h"

namespace maneuver::artifact {
struct StoredModel;
}

namespace maneuver::inference {

enum class Precision { kAuto, kBf16, kF32 };  // kAuto: bf16 if the processor has it

struct EngineOptions {
  Precision precision = Precision::kAuto;
};

// Where the latent z of an action comes from.
enum class LatentSource {
  kPosterior,  // q(z|y,s)
  kPrior,      // p(z|y)
};

// A covariance at each waypoint, target frame. [T, 3] xx, xy, yy, square metres
using WaypointCovariances = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;

// The predicted distribution of one action, target frame.
struct ActionDistribution {
  int action = 0;
  Eigen::VectorXd latent_mean;    // [D]
  Eigen::VectorXd latent_stddev;  // [D]
  TrajectorySet sigma;            // [2D+1]: the mean, then + and - one stddev along each dimension
  Trajectory moment_mean;         // [T, 2]
  WaypointCovariances moment_covariance;  // of the sigma points plus the decoder's own

  Eigen::Map<const Trajectory> mean() const { return sigma[0]; }
};

// Which action a trajectory belongs to.
struct Classification {
  Eigen::VectorXd responsibilities;   // q(y|x,s), [K], sums to 1
  double log_likelihood_bound = 0.0;  // nats
};

// What the networks read of a scene.
struct SceneInputsView {
  const scene::Raster* raster = nullptr;  // as scene::Rasterizer draws it; null without a raster
  scene::MotionInputs motion{};           // ignored by a model that does not ask for it
  const scene::SceneVectors* vectors = nullptr;  // ignored by a model without scene vectors
};

// Returns a view of what a scene::SceneReader of the model's spec has read. `inputs` must outlive
// it.
inline SceneInputsView ViewOf(const scene::SceneInputs& inputs) {
  return {inputs.raster ? &*inputs.raster : nullptr, inputs.motion, &inputs.vectors};
}

// What the networks compute for a scene as a whole, before single actions are described.
struct SceneEncoding {
  Eigen::VectorXf features;       // [F'], see artifact::SceneFeatureCount
  Eigen::VectorXd probabilities;  // p(y|s), [K], sums to 1 within 1e-9
  // h_y of each action, [K, A] row-major; empty unless actions look at the lanes.
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> geometry;
  Trajectory reference;  // r(m), target frame, metres; empty for a model without a reference
  double speed = 0.0;    // along the heading at the prediction time, m/s
};

// Evaluates a model. Holds scratch memory, so each thread needs its own session. Keeps its model
// alive.
//
// In f32 an answer has the same bits whatever else is in the batch.
class InferenceSession {
 public:
  virtual ~InferenceSession() = default;

  // Computes features, p(y|s), the reference, and the actions relative to the lanes, for each
  // scene.
  //   encodings: as many as scenes.
  virtual void Encode(std::span<const SceneInputsView> scenes,
                      std::span<SceneEncoding> encodings) = 0;

  // Returns the distributions of the given actions (0 .. K-1, any order), in that order. Does not
  // evaluate the scenario encoders of other actions.
  //
  // kPosterior: decodes q(z|y,s) and adds the reference and the residual of the mean. Needs an
  // encoding that Encode wrote. kPrior: decodes p(z|y) and adds only the reference. An encoding
  // without features will do (DrivingStraight, or a default one: at rest). A covariance that
  // depends on the scene is then computed from features of 0.
  virtual std::vector<ActionDistribution> Describe(const SceneEncoding& encoding,
                                                   std::span<const int> actions,
                                                   LatentSource source) = 0;

  // Returns only the mean trajectories of the given actions, in that order. Decodes one point per
  // action, where Describe decodes 2D+1. In f32 they have the same bits as
  // ActionDistribution::mean().
  virtual TrajectorySet MeanTrajectories(const SceneEncoding& encoding,
                                         std::span<const int> actions, LatentSource source) = 0;

  // Returns q(y|x,s) of a trajectory that was driven in this scene, and the bound on ln p(x|s). The
  // bound uses p(x|z) around the reference plus the decoded latent, without the residual of the
  // mean.
  virtual Classification Classify(const SceneEncoding& encoding, const Trajectory& trajectory) = 0;
};

// A model version in memory. Immutable; safe to share between threads.
class ActionModel : public std::enable_shared_from_this<ActionModel> {
 public:
  // Loads a model folder. Errors: those of artifact::ReadModelFolder and of FromStored.
  static absl::StatusOr<std::shared_ptr<const ActionModel>> Load(
      const std::filesystem::path& folder, const EngineOptions& options);
  // Makes a model from memory. FAILED_PRECONDITION for a precision that the processor lacks;
  // INTERNAL if the networks cannot be prepared.
  static absl::StatusOr<std::shared_ptr<const ActionModel>> FromStored(
      artifact::StoredModel stored, const EngineOptions& options);

  virtual ~ActionModel() = default;

  virtual const v1::ModelManifest& manifest() const = 0;
  const v1::ModelSpec& spec() const { return manifest().spec(); }
  virtual std::string_view precision() const = 0;  // "f32" or "bf16", as evaluated
  virtual size_t weight_bytes() const = 0;
  virtual std::unique_ptr<InferenceSession> NewSession() const = 0;
};

// Returns an encoding without a scene: the target drives straight on at `speed`, m/s. For generic
// actions, with LatentSource::kPrior. A model without a reference gives the same trajectories at
// any speed.
SceneEncoding DrivingStraight(const v1::ModelSpec& spec, double speed);

// Returns the generic action set: p(z|y=k) decoded for all k, with the given usage and
// effectiveness. Used when a model is exported, before its manifest has actions.
//   usage: mean p(y|s) of each action, [K]
//   effective: whether an action has a probability of at least 0.05 in some example, [K]
//   speed: at which the actions of a model with a reference are drawn, m/s
inline constexpr double kActionSetSpeed = 10.0;  // of the actions that a manifest stores
std::vector<v1::Action> DecodeActionSet(const ActionModel& model, std::span<const double> usage,
                                        std::span<const bool> effective,
                                        double speed = kActionSetSpeed);

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_ACTION_MODEL_H_
