// What a candidate version would have answered for targets that another version has answered.

#ifndef MANEUVER_SERVER_SERVING_SHADOW_COMPARISON_H_
#define MANEUVER_SERVER_SERVING_SHADOW_COMPARISON_H_

#include <memory>

#include "absl/status/statusor.h"
#include "model/evaluation/answer_difference.h"
#include "model/inference/action_model.h"
#include "server/serving/prediction_call.h"
#include "server/serving/served_model.h"

namespace maneuver::serving {

// Two versions, and engines of its own to evaluate them: it leases none from those who serve. Used
// by one thread at a time; keeps both versions in memory.
//
// A target takes three steps, so that whoever has better to do can come in between.
class ShadowComparison {
 public:
  // Actions that are less probable are left out of a version's mixture of trajectories.
  static constexpr double kLeastProbability = 0.001;

  // INVALID_ARGUMENT if the versions cannot be compared (evaluation::AnswerComparison).
  static absl::StatusOr<std::unique_ptr<ShadowComparison>> Make(ModelHandle answered,
                                                                ModelHandle candidate);

  const evaluation::AnswerComparison& comparison() const { return comparison_; }

  // FAILED_PRECONDITION if the candidate sees no state of the target at the prediction time, since
  // its frames are closer together, or has not learned to predict agents of its type.
  absl::Status Read(const Target& target);
  // INTERNAL if the candidate's probabilities are no numbers.
  absl::Status Encode();
  //   answered: of this target. INTERNAL if a difference is no number.
  absl::StatusOr<evaluation::AnswerDifference> Compare(const inference::SceneEncoding& answered);

 private:
  ShadowComparison(ModelHandle answered, ModelHandle candidate,
                   evaluation::AnswerComparison comparison);

  const ModelHandle answered_;
  const ModelHandle candidate_;
  const evaluation::AnswerComparison comparison_;
  const std::unique_ptr<inference::InferenceSession> answered_session_;
  Engine candidate_engine_;
  inference::SceneEncoding candidate_encoding_;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_SHADOW_COMPARISON_H_
