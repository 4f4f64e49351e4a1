#include "model/kernels/set_pooling.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "model/kernels/kernel_choice.h"

// What follows is compiled once for each target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "model/kernels/set_pooling.cc"
#include <hwy/foreach_target.h>
// It must come after foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace maneuver::kernels::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::ScalableTag<float>;
using Vector = hn::Vec<Floats>;
constexpr int kLanes = hn::MaxLanes(Floats());

// Elements whose weights are kept at once; sets have at most a dozen.
constexpr int kMostElements = 64;

// Calls call(load, store, i) for vectors of `count` numbers from i on. The last may be shorter.
template <class Call>
HWY_INLINE void ForVectors(int count, const Call& call) {
  const Floats d;
  int i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    call([d](const float* from) HWY_ATTR { return hn::LoadU(d, from); },
         [d](Vector vector, float* to) HWY_ATTR { hn::StoreU(vector, d, to); }, i);
  }
  if (i == count) return;
  const auto rest = hn::FirstN(d, static_cast<size_t>(count - i));
  call([d, rest](const float* from) HWY_ATTR { return hn::MaskedLoad(rest, d, from); },
       [d, rest](Vector vector, float* to) HWY_ATTR { hn::BlendedStore(vector, rest, d, to); }, i);
}

// Writes the softmax of one head's scores, without the division by their sum, which it returns.
float Weigh(const float* scores, int count, int heads, float* weights) {
  float largest = scores[0];
  for (int i = 1; i < count; ++i) largest = std::max(largest, scores[i * heads]);
  float sum = 0.0f;
  for (int i = 0; i < count; ++i) {
    weights[i] = std::exp(scores[i * heads] - largest);
    sum += weights[i];
  }
  return sum;
}

// Of at least one element and at most kMostElements.
void FastPool(const float* elements, const float* scores, int count, SetShape shape,
              float* pooled) {
  const Floats d;
  const int channels = shape.width / shape.heads;
  float weights[kMostElements];
  for (int head = 0; head < shape.heads; ++head) {
    const Vector sum = hn::Set(d, Weigh(scores + head, count, shape.heads, weights));
    const float* const first = elements + head * channels;
    float* const attended = pooled + head * channels;
    ForVectors(channels, [&](const auto& load, const auto& store, int channel) HWY_ATTR {
      Vector weighted = hn::Zero(d);
      Vector maximum = hn::Zero(d);
      for (int i = 0; i < count; ++i) {
        const Vector element = load(first + i * shape.width + channel);
        weighted = hn::Add(weighted, hn::Mul(hn::Set(d, weights[i]), element));
        maximum = hn::Max(maximum, element);
      }
      store(hn::Div(weighted, sum), attended + channel);
      store(maximum, attended + shape.width + channel);
    });
  }
}

void FastAddTwoAndRectify(const float* a, const float* b, int count, float* y) {
  ForVectors(count, [&](const auto& load, const auto& store, int i) HWY_ATTR {
    const Vector sum = hn::Add(hn::Add(load(y + i), load(a + i)), load(b + i));
    store(hn::Max(hn::Zero(Floats()), sum), y + i);
  });
}

}  // namespace
}  // namespace maneuver::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace maneuver::kernels {
namespace {

void PlainPool(const float* elements, const float* scores, int count, SetShape shape,
               float* pooled) {
  const int channels = shape.width / shape.heads;
  std::fill_n(pooled, 2 * shape.width, 0.0f);
  for (int channel = 0; channel < shape.width && count > 0; ++channel) {
    const int head = channel / channels;
    float largest = scores[head];
    for (int i = 1; i < count; ++i) largest = std::max(largest, scores[i * shape.heads + head]);
    float sum = 0.0f;
    for (int i = 0; i < count; ++i) {
      const float weight = std::exp(scores[i * shape.heads + head] - largest);
      const float element = elements[i * shape.width + channel];
      sum += weight;
      pooled[channel] += weight * element;
      // As vectors have it: the second of the two, if one is not a number.
      float& maximum = pooled[shape.width + channel];
      if (!(element < maximum)) maximum = element;
    }
    pooled[channel] /= sum;
  }
}

void PlainAddTwoAndRectify(const float* a, const float* b, int count, float* y) {
  for (int i = 0; i < count; ++i) {
    const float sum = (y[i] + a[i]) + b[i];
    y[i] = sum < 0.0f ? 0.0f : sum;  // what is not a number stays
  }
}

HWY_EXPORT(FastPool);
HWY_EXPORT(FastAddTwoAndRectify);

}  // namespace

void PoolSet(const float* elements, const float* scores, int count, SetShape shape, float* pooled) {
  const bool fast = !UsesPlainKernels() && count > 0 && count <= HWY_NAMESPACE::kMostElements;
  const auto pool = fast ? HWY_DYNAMIC_DISPATCH(FastPool) : PlainPool;
  pool(elements, scores, count, shape, pooled);
}

void AddTwoAndRectify(const float* a, const float* b, int count, float* y) {
  const auto add =
      UsesPlainKernels() ? PlainAddTwoAndRectify : HWY_DYNAMIC_DISPATCH(FastAddTwoAndRectify);
  add(a, b, count, y);
}

}  // namespace maneuver::kernels
#endif  // HWY_ONCE
