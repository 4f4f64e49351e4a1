// Computes what a candidate version would have answered for targets that another version has
// answered, and compares the two answers.

#ifndef MANEUVER_SERVER_SERVING_SHADOW_COMPARISON_H_
#define MANEUVER_SERVER_SERVING_SHADOW_COMPARISON_H_

#include <memory>

#include "absl/status/statusor.h"
#include "model/evaluation/answer_difference.h"
#include "model/inference/action_model.h"
#include "server/serving/prediction_call.h"
#include "server/serving/served_model.h"

namespace maneuver::serving {

// Holds two versions and its own engines, so it takes none from callers. Used by one thread at a
// time.
//
// Each target takes three steps, Read, Encode and Compare, so that more urgent work can run between
// them.
class ShadowComparison {
 public:
  // Actions that are less probable are left out of a version's mixture of trajectories.
  static constexpr double kLeastProbability = 0.001;

  // Prepares the comparison. INVALID_ARGUMENT if the versions cannot be compared
  // (evaluation::AnswerComparison).
  static absl::StatusOr<std::unique_ptr<ShadowComparison>> Make(ModelHandle answered,
                                                                ModelHandle candidate);

  const evaluation::AnswerComparison& comparison() const { return comparison_; }

  // Reads a target's scene as the candidate sees it. FAILED_PRECONDITION if the candidate has not
  // learned to predict agents of its type, or finds no state of the target at the prediction time
  // because its frames are closer together.
  absl::Status Read(const Target& target);
  // Runs the candidate's networks. INTERNAL if its probabilities are not finite.
  absl::Status Encode();
  // Compares the two answers. INTERNAL if a difference is not finite.
  //   answered: the encoding from which this target was answered.
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
