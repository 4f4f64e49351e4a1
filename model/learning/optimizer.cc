#include "model/learning/optimizer.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "model/kernels/adamw_step.h"
#include "model/learning/parallel.h"

namespace maneuver::learning {
namespace {

using kernels::AdamWStep;
using kernels::kBeta1;
using kernels::kBeta2;

// Numbers that are worth a thread.
constexpr int64_t kNumbersPerThread = 1 << 15;

// Whether a tensor's numbers lie one after the other, in the order of the other's.
bool IsInStep(const at::Tensor& tensor, const at::Tensor& other) {
  return tensor.is_cpu() && tensor.scalar_type() == at::kFloat &&
         tensor.is_non_overlapping_and_dense() && tensor.strides() == other.strides();
}

// Steps by tensor operations, of any device and layout: each operation for all tensors at once,
// since a GPU takes longer to begin one than to run it.
class TensorSteps {
 public:
  void Add(const AdamWStep& step, const at::Tensor& gradient, const at::Tensor& parameter,
           const at::Tensor& first, const at::Tensor& second) {
    gradients_.push_back(gradient);
    parameters_.push_back(parameter);
    firsts_.push_back(first);
    seconds_.push_back(second);
    kept_.emplace_back(1.0 - step.rate * step.decay);
    rates_.emplace_back(-step.rate / step.correction1);
    correction2_ = step.correction2;
  }

  void Take() const {
    if (parameters_.empty()) return;
    at::_foreach_mul_(firsts_, kBeta1);
    at::_foreach_add_(firsts_, gradients_, 1.0 - kBeta1);
    at::_foreach_mul_(seconds_, kBeta2);
    at::_foreach_addcmul_(seconds_, gradients_, gradients_, 1.0 - kBeta2);
    const std::vector<at::Tensor> scales = at::_foreach_sqrt(seconds_);
    at::_foreach_div_(scales, std::sqrt(correction2_));
    at::_foreach_add_(scales, kernels::kEpsilon);
    at::_foreach_mul_(parameters_, kept_);
    at::_foreach_addcdiv_(parameters_, firsts_, scales, rates_);
  }

 private:
  std::vector<at::Tensor> gradients_, parameters_, firsts_, seconds_;
  std::vector<at::Scalar> kept_, rates_;
  double correction2_ = 1.0;
};

}  // namespace

double LearningRateShare(int64_t step, int64_t warm_up, int64_t steps) {
  // A short run warms up over at most a tenth of it.
  warm_up = std::min(warm_up, steps / 10);
  if (step < warm_up) return static_cast<double>(step + 1) / static_cast<double>(warm_up + 1);
  const double done = static_cast<double>(step - warm_up) /
                      static_cast<double>(std::max<int64_t>(1, steps - warm_up));
  return 0.5 * (1.0 + std::cos(std::numbers::pi * std::min(1.0, done)));
}

void AdamW::Add(const std::vector<at::Tensor>& parameters, double rate, double decay) {
  for (const at::Tensor& parameter : parameters) {
    slots_.push_back({parameter, at::zeros_like(parameter.detach()),
                      at::zeros_like(parameter.detach()), rate, parameter.dim() > 1 ? decay : 0.0});
  }
}

void AdamW::Add(const std::vector<at::Tensor>& parameters, const std::vector<bool>& decays,
                double rate, double decay) {
  for (size_t i = 0; i < parameters.size(); ++i) {
    Add({parameters[i]}, rate, decays[i] ? decay : 0.0);
  }
}

std::vector<at::Tensor> AdamW::Parameters() const {
  std::vector<at::Tensor> parameters;
  for (const Slot& slot : slots_) parameters.push_back(slot.parameter);
  return parameters;
}

void AdamW::Step(double share) {
  at::NoGradGuard no_grad;
  ++step_;
  const double correction1 = 1.0 - std::pow(kBeta1, static_cast<double>(step_));
  const double correction2 = 1.0 - std::pow(kBeta2, static_cast<double>(step_));
  TensorSteps others;
  for (Slot& slot : slots_) {
    const at::Tensor gradient = slot.parameter.grad();
    if (!gradient.defined()) continue;
    const AdamWStep step{slot.rate * share, slot.decay, correction1, correction2};
    if (IsInStep(slot.parameter, gradient) && IsInStep(gradient, slot.first_moment) &&
        IsInStep(slot.first_moment, slot.second_moment) &&
        IsInStep(slot.second_moment, slot.parameter)) {
      const float* const g = gradient.data_ptr<float>();
      float* const x = slot.parameter.data_ptr<float>();
      float* const m = slot.first_moment.data_ptr<float>();
      float* const v = slot.second_moment.data_ptr<float>();
      at::parallel_for(0, gradient.numel(), kNumbersPerThread, [&](int64_t begin, int64_t end) {
        kernels::TakeStep(step, end - begin, g + begin, x + begin, m + begin, v + begin);
      });
    } else {
      others.Add(step, gradient, slot.parameter, slot.first_moment, slot.second_moment);
    }
    // Resets instead of zeroing: the next backward pass then stores its gradient, and adds nothing.
    slot.parameter.mutable_grad().reset();
  }
  others.Take();
}

AdamW::State AdamW::Save() const {
  State state{step_, {}};
  for (const Slot& slot : slots_) {
    state.moments.push_back(slot.first_moment.clone());
    state.moments.push_back(slot.second_moment.clone());
  }
  return state;
}

void AdamW::Restore(const State& state) {
  TORCH_CHECK(state.moments.size() == 2 * slots_.size(), "the optimizer has ", slots_.size(),
              " parameters, its state ", state.moments.size() / 2);
  step_ = state.steps;
  for (size_t i = 0; i < slots_.size(); ++i) {
    slots_[i].first_moment.copy_(state.moments[2 * i]);
    slots_[i].second_moment.copy_(state.moments[2 * i + 1]);
  }
}

void AdamW::ZeroGradients() {
  for (Slot& slot : slots_) slot.parameter.mutable_grad().reset();
}

}  // namespace maneuver::learning
