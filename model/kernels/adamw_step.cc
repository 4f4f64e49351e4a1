#include "model/kernels/adamw_step.h"

#include <cmath>

#include "model/kernels/kernel_choice.h"

// What follows is compiled once for each target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "model/kernels/adamw_step.cc"
#include <hwy/foreach_target.h>
// It must come after foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace maneuver::kernels::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// A vector of numbers. Products and sums are rounded one by one, as in the plain loop.
template <class D>
HWY_INLINE void StepVector(D d, const AdamWFactors& factors, const float* gradient,
                           float* parameter, float* first, float* second) {
  const auto g = hn::LoadU(d, gradient);
  const auto old_m = hn::LoadU(d, first);
  const auto m = hn::Add(old_m, hn::Mul(hn::Set(d, AdamWFactors::kGain1), hn::Sub(g, old_m)));
  const auto v = hn::Add(hn::Mul(hn::Set(d, AdamWFactors::kKeep2), hn::LoadU(d, second)),
                         hn::Mul(hn::Set(d, AdamWFactors::kGain2), hn::Mul(g, g)));
  hn::StoreU(m, d, first);
  hn::StoreU(v, d, second);
  const auto divisor =
      hn::Add(hn::Mul(hn::Sqrt(v), hn::Set(d, factors.scale)), hn::Set(d, AdamWFactors::kLeast));
  const auto change = hn::Div(hn::Mul(hn::Set(d, factors.rate), m), divisor);
  const auto kept = hn::Mul(hn::Set(d, factors.kept), hn::LoadU(d, parameter));
  hn::StoreU(hn::Sub(kept, change), d, parameter);
}

void TakeFastStep(const AdamWFactors& factors, int64_t count, const float* gradient,
                  float* parameter, float* first, float* second) {
  const hn::ScalableTag<float> d;
  const auto lanes = static_cast<int64_t>(hn::Lanes(d));
  int64_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    StepVector(d, factors, gradient + i, parameter + i, first + i, second + i);
  }
  for (; i < count; ++i) {
    StepVector(hn::CappedTag<float, 1>(), factors, gradient + i, parameter + i, first + i,
               second + i);
  }
}

}  // namespace
}  // namespace maneuver::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace maneuver::kernels {
namespace {

void TakePlainStep(const AdamWFactors& factors, int64_t count, const float* gradient,
                   float* parameter, float* first, float* second) {
  using F = AdamWFactors;
  for (int64_t i = 0; i < count; ++i) {
    const float g = gradient[i];
    const float m = first[i] + F::kGain1 * (g - first[i]);
    const float v = F::kKeep2 * second[i] + F::kGain2 * (g * g);
    first[i] = m;
    second[i] = v;
    parameter[i] =
        factors.kept * parameter[i] - factors.rate * m / (std::sqrt(v) * factors.scale + F::kLeast);
  }
}

HWY_EXPORT(TakeFastStep);

}  // namespace

void TakeStep(const AdamWStep& step, int64_t count, const float* gradient, float* parameter,
              float* first, float* second) {
  const AdamWFactors factors(step);
  const auto take = UsesPlainKernels() ? TakePlainStep : HWY_DYNAMIC_DISPATCH(TakeFastStep);
  take(factors, count, gradient, parameter, first, second);
}

}  // namespace maneuver::kernels
#endif  // HWY_ONCE
