// The terms of the bound that is maximised, after Richter, Barragan and Karaman, "Learning and
// Predicting Multimodal Vehicle Action Distributions in a Unified Probabilistic Model Without
// Labels".
//
// Shorthand of the paper: p_y = p(y|s), p_z = p(z|y), q_z = q(z|x), q_z' = q(z'|y,s),
// q_y = q(y|x,s). Every term is a tensor [B], one number an example, in nats.

#ifndef MANEUVER_MODEL_LEARNING_OBJECTIVES_H_
#define MANEUVER_MODEL_LEARNING_OBJECTIVES_H_

#include "model/learning/gaussian.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Returns ln p(x|z) = ln N(x; decoded, stddev^2 I), over the last dimension (the 2T coordinates).
at::Tensor LogLikelihood(const at::Tensor& trajectories, const at::Tensor& decoded, double stddev);

// Returns ln q_y of the base model, q_y ~ p_y exp(-H(q_z, p_z)): the E-step, in closed form. [B, K]
//   log_p_y: [B, K] or [K];  cross_entropy: H(q_z, p_z), [B, K]
at::Tensor BaseLogResponsibilities(const at::Tensor& log_p_y, const at::Tensor& cross_entropy);

// Returns ln q_y of the unified model as the paper prints it, q_y ~ p_y exp(-H(q_z, p_z) - KL(q_z'
// || p_z')). It leaves out E ln p(x'|z'), so it does not maximise the bound: holding it fixed in
// each step is part of its definition. [B, K]
at::Tensor UnifiedLogResponsibilities(const at::Tensor& log_p_y, const at::Tensor& cross_entropy,
                                      const at::Tensor& posterior_divergence);

// Returns the ln q_y that maximises the bound of the unified model, q_y ~ p_y exp(-H(q_z, p_z) + E
// ln p(x'|z') - KL(q_z' || p_z')). [B, K]
//   posterior_reconstruction: ln p(x'|z') of a sample of each q_z', weighted as in the loss, [B, K]
at::Tensor ExactLogResponsibilities(const at::Tensor& log_p_y, const at::Tensor& cross_entropy,
                                    const at::Tensor& posterior_reconstruction,
                                    const at::Tensor& posterior_divergence);

// Returns ln q_y, with one-hot responsibilities for labelled examples (Discussion: partial labels).
//   labels: [B] 0 .. K-1, or -1 for no label; may be undefined
at::Tensor WithLabels(const at::Tensor& log_q_y, const at::Tensor& labels);

// Returns KL(q_y || p_y).
at::Tensor ActionDivergence(const at::Tensor& log_q_y, const at::Tensor& log_p_y);

// Returns sum_y q_y f_y, which takes KL(q_z||p_z), ln p(x'|z') and KL(q_z'||p_z') in expectation
// over the actions.
//   values: f_y, [B, K]
at::Tensor ExpectOverActions(const at::Tensor& log_q_y, const at::Tensor& values);

// The terms of the bound L, each a tensor [B]. Terms that a phase does not have are undefined.
//   base     L = reconstruction - action_divergence - latent_divergence
//   dual     L = posterior_reconstruction - posterior_divergence; only q(z|y,s) learns
//   unified  L = base + posterior_reconstruction - posterior_divergence
struct BoundTerms {
  at::Tensor reconstruction;            // ln p(x|z), z one sample of q_z
  at::Tensor action_divergence;         // KL(q_y || p_y)
  at::Tensor latent_divergence;         // sum_y q_y KL(q_z || p_z)
  at::Tensor posterior_reconstruction;  // sum_y q_y ln p(x'|z'), z' one sample of each q_z'
  at::Tensor posterior_divergence;      // sum_y q_y KL(q_z' || p_z')
  at::Tensor log_responsibilities;      // ln q_y, [B, K]
};

struct BoundWeights {
  double action = 1.0;
  double posterior_reconstruction = 1.0;
  double posterior_divergence = 1.0;
  double latent_divergence = 1.0;
};

// The outputs of the base model for a batch.
struct BaseModel {
  at::Tensor trajectories;  // x, relative to the reference if there is one, [B, 2T]
  at::Tensor decoded;       // mean of p(x|z~), [B, 2T]
  Gaussian q_z;             // [B, D]
  Gaussian p_z;             // [K, D]
  at::Tensor log_p_y;       // [B, K] or [K]
  double decoder_stddev = 1.0;
  at::Tensor labels = {};  // [B] actions that are known, -1 where they are not; may be undefined
};

// The further outputs of the unified model.
struct PosteriorBranch {
  at::Tensor decoded;  // mean of p(x'|z'~) for each action that is decoded, [B, n, 2T]
  Gaussian q_z;        // q_z', [B, K, D]
  // The actions that are decoded, [B, n]; undefined: all K in their order. The reconstruction is
  // over these alone, with their q_y normalised among themselves.
  at::Tensor actions = {};
  // Distance at which the reconstruction changes from quadratic to linear, metres; 0: always
  // quadratic.
  double huber = 0.0;
};

// Returns -rho(x - decoded) / stddev^2 with the pseudo-Huber loss of each waypoint's distance e,
//   rho(e) = h^2 (sqrt(1 + e^2 / h^2) - 1),
// which is e^2 / 2 for e << h and h e for e >> h; summed over the waypoints. [...]
//   trajectories, decoded: [..., 2T]
at::Tensor RobustReconstruction(const at::Tensor& trajectories, const at::Tensor& decoded,
                                double stddev, double huber);

// Returns the bound of the base model. The responsibilities get no gradient.
BoundTerms BaseBound(const BaseModel& model);
// Returns -ln q_y of each example's label y, with a gradient, where the q_y ignore labels. [B]
//   model.labels: [B], 0 .. K-1, one for every example
at::Tensor HeldCrossEntropy(const BaseModel& model);
// Returns the part of the dual objective that depends on q(z|y,s). q_y and p_y are the base
// model's.
BoundTerms DualBound(const BaseModel& model, const PosteriorBranch& posterior);
// Returns the bound of the unified model. The responsibilities get no gradient.
//   exact_weight: 0: responsibilities as the paper prints them; otherwise exact ones with this
//     weight of the posterior reconstruction, for which all actions must be decoded
BoundTerms UnifiedBound(const BaseModel& model, const PosteriorBranch& posterior,
                        double exact_weight = 0.0);

// Returns the loss, -L with weighted terms, averaged over the batch.
at::Tensor Loss(const BoundTerms& terms, const BoundWeights& weights);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_OBJECTIVES_H_
