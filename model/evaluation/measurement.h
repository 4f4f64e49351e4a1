// Measures single examples, before anything is averaged.

#ifndef MANEUVER_MODEL_EVALUATION_MEASUREMENT_H_
#define MANEUVER_MODEL_EVALUATION_MEASUREMENT_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "model/data/example_index.h"
#include "model/evaluation/baselines.h"
#include "model/evaluation/displacement.h"
#include "model/evaluation/envelope.h"
#include "model/evaluation/likelihood.h"
#include "model/evaluation/maneuver_labels.h"
#include "model/evaluation/relative_classes.h"
#include "model/evaluation/strata.h"
#include "model/evaluation/waymo_displacement.h"
#include "model/inference/action_model.h"
#include "model/inference/anchor_model.h"
#include "model/scene/observation_window.h"
#include "model/scene/road_map.h"
#include "model/scene/scene_reader.h"

namespace maneuver::evaluation {

// The values of k in minADE_k and similar metrics.
inline constexpr std::array<int, 4> kRanks = {1, 5, 6, 10};

struct BaselineErrors {
  DisplacementErrors displacement;
  WaymoErrors waymo;
};

// How good the distributions from one latent source are.
struct SourceMeasurement {
  std::array<DisplacementErrors, kRanks.size()> displacement;  // of the actions' mean trajectories
  MixtureNll nll;
  double action_nll = 0.0;  // of the example's action alone, nats a waypoint
  Envelope envelope;        // of the example's action
};

// How good an anchor baseline is.
struct AnchorMeasurement {
  Eigen::VectorXd probabilities;  // p(k|s), [K]
  int nearest = 0;                // the anchor nearest to the truth
  std::array<DisplacementErrors, kRanks.size()> displacement;
  std::array<WaymoErrors, kRanks.size()> waymo;
  MixtureNll nll;
};

struct Measurement {
  Eigen::VectorXd probabilities;                 // p(y|s), [K]
  Eigen::VectorXd responsibilities;              // q(y|x,s), [K]
  int action = 0;                                // the example's: argmax q(y|x,s)
  SourceMeasurement posterior;                   // from q(z|y,s)
  SourceMeasurement prior;                       // from p(z|y): the generic distributions
  std::array<WaymoErrors, kRanks.size()> waymo;  // from q(z|y,s)
  // Errors of the first k representatives (inference/representatives.h) instead of the k most
  // probable actions, from q(z|y,s). The first representative is the medoid.
  std::array<DisplacementErrors, kRanks.size()> cover;
  BaselineErrors constant_velocity;
  BaselineErrors constant_turn;                           // CTRA
  BaselineErrors faded;                                   // the faded roll-out
  std::optional<AnchorMeasurement> covernet;              // if the model's folder has baselines
  std::optional<AnchorMeasurement> multipath;             // if the model's folder has baselines
  std::optional<int> maneuver;                            // the class from ManeuverLabels, if any
  RelativeClass relative_class = RelativeClass::kStands;  // of the trajectory
  StratumKeys keys;                                       // of the target and its trajectory
};

// Measures an answer without its scene: sets the probabilities, the responsibilities, the action
// and the posterior of `measured`. Returns the distributions of q(z|y,s) of the actions 0 .. K-1.
//   encoding: of the scene, by the session's model
//   truth: what the target did, [T, 2] target frame, metres
std::vector<inference::ActionDistribution> MeasureAnswer(const inference::SceneEncoding& encoding,
                                                         const Trajectory& truth,
                                                         inference::InferenceSession& session,
                                                         Measurement* measured);

// What all threads share. Immutable. Keeps references to the model, the recordings and the labels,
// and to the baselines unless they are null.
struct MeasuringContext {
  MeasuringContext(const inference::ActionModel& model, std::span<const v1::Scenario> recordings,
                   const ManeuverLabels& labels, const inference::AnchorBaselines* baselines);

  const inference::ActionModel& model;
  std::span<const v1::Scenario> recordings;
  std::vector<scene::RoadMap> maps;  // of the recordings
  const ManeuverLabels& labels;
  std::vector<int> all_actions;  // 0 .. K-1
  // p(z|y) of each action, [K]; empty if it depends on the scene and is described per example.
  std::vector<inference::ActionDistribution> generic;
  std::vector<double> waypoint_times;  // [T] seconds
  WaymoMeasure waymo;
  scene::ObservationWindow window;
  const inference::AnchorBaselines* baselines;
};

// What an example's target really did. Defined where it is used.
struct ExampleTruth;

// One thread's worker: a session and its scratch memory.
class Measurer {
 public:
  static constexpr int kBatch = 8;  // examples at a time

  explicit Measurer(const MeasuringContext& context);

  // Measures a batch.
  //   examples: at most kBatch;  measured: one per example
  void Measure(std::span<const data::Example> examples, std::span<Measurement> measured);

 private:
  // Measures one baseline on the scenes read last, and writes the results to a field of `measured`.
  //   truths: one per scene
  void MeasureAnchors(std::span<const inference::SceneInputsView> scenes,
                      std::span<const ExampleTruth> truths, const inference::AnchorModel& model,
                      inference::InferenceSession& session,
                      std::optional<AnchorMeasurement> Measurement::*field,
                      std::span<Measurement> measured);
  Measurement MeasureOne(const data::Example& example, const ExampleTruth& truth,
                         const inference::SceneEncoding& encoding);
  SourceMeasurement MeasurePrior(const inference::SceneEncoding& encoding,
                                 std::span<const int> ranked, int action, const Trajectory& truth);

  const MeasuringContext& context_;
  std::unique_ptr<inference::InferenceSession> session_;
  std::unique_ptr<inference::InferenceSession> covernet_;   // null without baselines
  std::unique_ptr<inference::InferenceSession> multipath_;  // null without baselines
  inference::MlpScratch anchor_scratch_;
  scene::SceneReader reader_;
  std::vector<scene::SceneInputs> inputs_;  // [kBatch]
  std::vector<inference::SceneEncoding> encodings_;
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_MEASUREMENT_H_
