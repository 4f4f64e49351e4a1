// Measures a model on recordings that it should not have learned from.

#ifndef MANEUVER_MODEL_EVALUATION_EVALUATOR_H_
#define MANEUVER_MODEL_EVALUATION_EVALUATOR_H_

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_service.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/data/recording_blocks.h"
#include "model/evaluation/maneuver_labels.h"
#include "model/evaluation/measured_examples.h"
#include "model/inference/action_model.h"
#include "model/inference/anchor_model.h"

namespace maneuver::evaluation {

struct EvaluationInput {
  std::span<const v1::Scenario> recordings;  // all of them are measured
  // Recordings that are read block by block, in place of `recordings`; null: there are none.
  const data::RecordingBlocks* blocks = nullptr;
  // For the agreement with recorded manoeuvres; may be empty.
  std::span<const v1::ManeuverAnnotation> annotations;
  v1::ExampleSettings examples;  // complete
  // The baselines of the model's folder; null if it has none.
  const inference::AnchorBaselines* baselines = nullptr;
  int threads = 1;
  // The number of examples that the report contains (example_sample.h).
  int sampled_examples = 0;
  // Called now and then with the examples done and the total; returning false cancels the
  // evaluation. May be empty. Never called from two threads at once. The total is an estimate until
  // all recordings have been read.
  std::function<bool(int64_t done, int64_t total)> progress;
};

// Measures the model and returns a report. The metrics of the report follow. k is 1, 5, 6 and 10.
// The predictions are the mean trajectories of the k actions with the largest p(y|s). Distances are
// in metres, densities in nats.
//
//   ade_1, min_ade_k, fde_1, min_fde_k     errors of the best of the k (displacement.h)
//   brier_fde_k, miss_rate_k               as in Argoverse 2
//   miss_rate_nuscenes_k                   as in nuScenes
//   ade_waymo_1, min_ade_waymo_k, fde_waymo_1, min_fde_waymo_k, miss_rate_waymo_k
//                                          as in Waymo's benchmark
//                                          (waymo_displacement.h); absent if the horizon is below
//                                          3 s
//   ade_medoid, fde_medoid, miss_rate_medoid
//                                          of the medoid, the best single answer
//                                          (inference/representatives.h), as ade_1 and miss_rate_1
//   min_ade_cover_k, min_fde_cover_k, miss_rate_cover_k
//                                          k = 5, 6, 10: of the first k representatives instead of
//                                          the k most probable actions
//   ade_cv, fde_cv, miss_rate_cv, ...      the same for constant velocity; with _ctra for constant
//                                          turn rate and acceleration, with _faded for the faded
//                                          roll-out (baselines.h)
//   ade_ratio, fde_ratio                   ade_1 / ade_cv, fde_1 / fde_cv
//   ade_medoid_ratio, fde_medoid_ratio     ade_medoid / ade_cv, fde_medoid / fde_cv
//   min_ade_6_ratio, min_fde_6_ratio       min_ade_6 / ade_cv, min_fde_6 / fde_cv
//   nll, nll_joint                         of the mixture over all actions (likelihood.h)
//   nll_action                             of the example's action alone, argmax q(y|x,s), nats per
//                                          waypoint
//   coverage_1sigma, coverage_2sigma       of that action's ellipses (envelope.h), with the
//                                          decoder's covariance
//   coverage_1sigma_latent, coverage_2sigma_latent
//                                          with the latent's covariance alone
//   mean_sigma_posterior, mean_sigma_prior
//                                          width of that action's latent envelope from q(z|y,s)
//                                          and from p(z|y), metres
//   mean_sigma_ratio                       the first of these divided by the second
//   ade_1_prior, min_ade_k_prior, ..., miss_rate_k_prior, nll..._prior, coverage..._prior
//                                          the same for the generic distributions p(z|y) instead of
//                                          q(z|y,s)
//   effective_actions, action_perplexity, action_entropy, mutual_information, calibration_error
//                                          see calibration.h
//   largest_share                          the largest mean p(y|s) of an action
//   nmi, purity                            argmax q(y|x,s) against the recorded manoeuvre that
//                                          covers most of the horizon; absent without annotations
//   labelled_examples                      the number of examples of those two
//   covernet_NAME, multipath_NAME          of the anchor baselines of the model's folder, if given
//                                          (artifact/anchor_baselines.h): ade_1, min_ade_k, fde_1,
//                                          min_fde_k, brier_fde_k, the miss rates, nll, nll_joint,
//                                          effective_actions, action_perplexity, largest_share,
//                                          mutual_information and calibration_error, as above, with
//                                          the nearest anchor's one-hot in place of q(y|x,s)
//   nmi_kinematic, purity_kinematic        argmax q(y|x,s) against the classes of
//                                          kinematic_classes.h
//   nmi_relative, purity_relative          the same against those of relative_classes.h
//   class_information_kinematic, class_information_relative
//                                          how much argmax q(y|x,s) tells about the class once the
//                                          target's speed stratum (strata.h) is known: the share of
//                                          the remaining uncertainty, adjusted for chance
//                                          (class_information.h)
//   named_share_relative                   the share of the examples whose action has at least 70 %
//                                          of its examples in one relative class; chance favours
//                                          actions with few examples
//   named_share_motion                     the same, with *stands* counted as *keeps speed*,
//                                          because an action relative to the present motion cannot
//                                          tell them apart
//
// The report says which examples it covers (example_settings, trajectory, target_types). Its strata
// (strata.h) contain the main metrics. Its rivals (rival_comparison.h) say where the model is ahead
// of other predictors. The report has the same bits for any number of threads.
//
// Recordings are measured block by block, and only sums over their examples are kept. Besides one
// block, memory holds some 100 bytes for each recording, 300 for each annotation, and the state of
// a RecordingGrouper. To group the recordings, all blocks are read once before they are measured.
//
// FAILED_PRECONDITION if the recordings contain no example, or if the baselines read other inputs
// or predict other waypoints than the model; CANCELLED if `progress` returned false; OUT_OF_RANGE
// if a number of the report is not finite (CheckFinite); errors of RecordingBlocks::ForEach.
absl::StatusOr<v1::EvaluationReport> Evaluate(const inference::ActionModel& model,
                                              const EvaluationInput& input);

// Measures a model block by block. Not thread-safe.
class BlockMeasurer {
 public:
  // `model` and `input` must outlive the measurer.
  BlockMeasurer(const inference::ActionModel& model, const EvaluationInput& input);

  // Measures the examples of the next block of the input's recordings; there may be none.
  // FAILED_PRECONDITION if the baselines read or predict something else than the model; CANCELLED
  // if `progress` returned false.
  absl::StatusOr<MeasuredExamples> Measure(std::span<const v1::Scenario> block);

  // Returns FAILED_PRECONDITION if no block had an example.
  absl::Status CheckExamples() const;

 private:
  const inference::ActionModel& model_;
  const EvaluationInput& input_;
  const ManeuverLabels labels_;
  const int64_t all_recordings_;
  int64_t recordings_ = 0;  // of the blocks so far
  int64_t examples_ = 0;    // of these
};

// Calls `visit` with the recordings of an input, block by block. Errors: those of `visit` and of
// RecordingBlocks::ForEach.
absl::Status ForEachBlock(const EvaluationInput& input, const data::RecordingBlocks::Visit& visit);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_EVALUATOR_H_
