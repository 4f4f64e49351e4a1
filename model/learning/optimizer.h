// AdamW with a warm-up and cosine decay.

#ifndef MANEUVER_MODEL_LEARNING_OPTIMIZER_H_
#define MANEUVER_MODEL_LEARNING_OPTIMIZER_H_

#include <cstdint>
#include <vector>

#include "model/learning/tensors.h"

namespace maneuver::learning {

// Returns the share of the largest learning rate at a step: rises linearly over the warm-up, then
// follows half a cosine towards 0.
//   step: 0 .. steps-1;  warm_up: number of steps, but at most a tenth of `steps`
double LearningRateShare(int64_t step, int64_t warm_up, int64_t steps);

// AdamW (Loshchilov and Hutter, 2019), betas 0.9 and 0.999. Tensors of one dimension (biases,
// normalisations, the mixture's weights) do not decay. A parameter that decays by d cannot stay
// beyond 1 / d, whatever its gradient, because a step's gradient part is about the rate at most.
class AdamW {
 public:
  // Adds parameters that learn at `rate` and decay by `decay`.
  void Add(const std::vector<at::Tensor>& parameters, double rate, double decay);
  // Does the same, but only those of the parameters decay that `decays` says. Vectors never do.
  //   decays: one for each parameter
  void Add(const std::vector<at::Tensor>& parameters, const std::vector<bool>& decays, double rate,
           double decay);

  // Returns the parameters, in the order in which they were added.
  std::vector<at::Tensor> Parameters() const;

  // Takes one step down the gradients and clears them. Parameters without a gradient do not change.
  //   share: factor of each parameter's rate
  void Step(double share);
  // Everything that changes from step to step.
  struct State {
    int64_t steps = 0;
    std::vector<at::Tensor> moments;  // first and second of each parameter, as they were added
  };
  State Save() const;
  void Restore(const State& state);
  // Clears gradients.
  void ZeroGradients();

 private:
  struct Slot {
    at::Tensor parameter;
    at::Tensor first_moment;
    at::Tensor second_moment;
    double rate;
    double decay;
  };

  std::vector<Slot> slots_;
  int64_t step_ = 0;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_OPTIMIZER_H_
