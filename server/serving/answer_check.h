// Checks answers before they leave the server.

#ifndef MANEUVER_SERVER_SERVING_ANSWER_CHECK_H_
#define MANEUVER_SERVER_SERVING_ANSWER_CHECK_H_

#include <Eigen/Core>

#include "absl/status/status.h"
#include "server/serving/prediction_call.h"

namespace maneuver::serving {

// Both functions return OK, or INTERNAL with the reason ANSWER_UNSOUND and a description of the
// fault.

// Checks that `probabilities` are finite, not negative, and sum to 1 within 1e-5. `what` names
// them: "p(y|s)".
absl::Status CheckProbabilities(const Eigen::VectorXd& probabilities, const char* what);

// Checks everything of `answer` that a caller may receive: probabilities and responsibilities as
// above; the weights of representatives sum to 1 within 1e-5; latents, trajectories, means and the
// likelihood bound are finite; each covariance is finite and, within rounding, positive
// semi-definite. Costs some microseconds for all actions of a model.
absl::Status CheckAnswer(const TargetAnswer& answer);

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_ANSWER_CHECK_H_
