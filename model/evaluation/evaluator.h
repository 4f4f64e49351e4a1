// Measures a model on recordings that it should not have learned from.

#ifndef MANEUVER_MODEL_EVALUATION_EVALUATOR_H_
#define MANEUVER_MODEL_EVALUATION_EVALUATOR_H_

#include <cstdint>
#include <functional>
#include <span>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_service.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/inference/action_model.h"

namespace maneuver::evaluation {

struct EvaluationInput {
  std::span<const v1::Scenario> recordings;  // all of them are measured
  // For agreement with recorded manoeuvres; may be empty.
  std::span<const v1::ManeuverAnnotation> annotations;
  v1::ExampleSettings examples;  // complete
  int threads = 1;
  // Called now and then with examples done and in all; false stops the evaluation. May be empty.
  // Called from one thread at a time.
  std::function<bool(int64_t done, int64_t total)> progress;
};

// The report's metrics, metres and nats:
//   ade_1, fde_1                the most probable action's mean trajectory
//   min_ade_6, min_fde_6        the best of the six most probable
//   miss_rate_6                 share with no final position of those within 2 m (Argoverse 2)
//   ade_cv, fde_cv              constant velocity, from the state at the prediction time
//   miss_rate_cv                likewise
//   ade_ratio, fde_ratio        ade_1 / ade_cv, fde_1 / fde_cv
//   nll                         mixture over all actions, a waypoint
//   effective_actions, action_perplexity, mutual_information, calibration_error: see calibration.h
//   nmi, purity                 argmax q(y|x,s) against the recorded manoeuvre that covers most of
//                               the horizon; absent without annotations
//   labelled_examples           how many examples those two are over
// FAILED_PRECONDITION if the recordings hold no example; CANCELLED if `progress` said so.
absl::StatusOr<v1::EvaluationReport> Evaluate(const inference::ActionModel& model,
                                              const EvaluationInput& input);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_EVALUATOR_H_
