// Infers the weights of the mixture with a sparse Dirichlet prior, which switches off actions that
// are not needed.
//
// Variational treatment after Bishop, "Pattern Recognition and Machine Learning", section 10.2:
// with pi ~ Dirichlet(alpha_0, ..., alpha_0), q(pi) = Dirichlet(alpha_0 + N_1, ..., alpha_0 + N_K),
// where N_k is the number of observations with action k, by their responsibilities. Counts are
// updated batch by batch (stochastic variational inference: Hoffman et al. 2013, equation 6).

#ifndef MANEUVER_MODEL_LEARNING_DIRICHLET_WEIGHTS_H_
#define MANEUVER_MODEL_LEARNING_DIRICHLET_WEIGHTS_H_

#include <vector>

#include "model/learning/tensors.h"

namespace maneuver::learning {

// Returns E[ln pi_k] under Dirichlet(counts) = psi(counts_k) - psi(sum counts), [K]. Unlike the
// logarithm of the mean it falls without bound as a count goes to 0.
//   counts: alpha_0 + N_k, positive, [K]
at::Tensor ExpectedLogWeights(const at::Tensor& counts);

// Returns the counts after a batch, [K]: a step of `rate` from `counts` towards alpha_0 +
// observations * mean_i q(y_i = k).
//   responsibilities: q(y|x), [B, K]
//   observations: how many the data have: sum_k N_k;  concentration: alpha_0
at::Tensor FollowCounts(const at::Tensor& counts, const at::Tensor& responsibilities,
                        double observations, double concentration, double rate);

// Returns the actions with fewer than one observation.
std::vector<int> UnneededActions(const at::Tensor& counts, double concentration);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_DIRICHLET_WEIGHTS_H_
