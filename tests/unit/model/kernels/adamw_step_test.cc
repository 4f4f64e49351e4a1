#include "model/kernels/adamw_step.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/unit/model/kernels/kernel_test.h"

namespace maneuver::kernels::adamw_step_test {
namespace {

constexpr AdamWStep kStep = {
    .rate = 0.01, .decay = 0.1, .correction1 = 0.19, .correction2 = 0.001999};

struct Numbers {
  explicit Numbers(size_t count)
      : parameter(RandomValues(count, 1)), first(RandomValues(count, 2)), second(count) {
    for (size_t i = 0; i < count; ++i) second[i] = first[i] * first[i];
  }
  bool operator==(const Numbers&) const = default;

  std::vector<float> parameter;
  std::vector<float> first;
  std::vector<float> second;
};

Numbers Step(size_t count) {
  Numbers numbers(count);
  const auto gradient = RandomValues(count, 3);
  TakeStep(kStep, static_cast<int64_t>(count), gradient.data(), numbers.parameter.data(),
           numbers.first.data(), numbers.second.data());
  return numbers;
}

class AdamWStepTest : public KernelTest {};
MANEUVER_TEST_EACH_TARGET(AdamWStepTest);

// Algorithm 2 of the paper.
TEST_P(AdamWStepTest, FollowsItsFormulas) {
  constexpr size_t kCount = 21;
  const Numbers before(kCount);
  const auto gradient = RandomValues(kCount, 3);
  const Numbers after = Step(kCount);
  for (size_t i = 0; i < kCount; ++i) {
    const double g = gradient[i];
    const double m = 0.9 * before.first[i] + 0.1 * g;
    const double v = 0.999 * before.second[i] + 0.001 * g * g;
    const double change = m / kStep.correction1 / (std::sqrt(v / kStep.correction2) + 1e-8);
    EXPECT_NEAR(after.first[i], m, 1e-6);
    EXPECT_NEAR(after.second[i], v, 1e-6);
    EXPECT_NEAR(after.parameter[i],
                before.parameter[i] - kStep.rate * (change + kStep.decay * before.parameter[i]),
                1e-6);
  }
}

TEST_P(AdamWStepTest, HasTheBitsOfPlain) {
  for (size_t count = 0; count < 70; ++count) {
    const auto step = [count] { return Step(count); };
    ASSERT_EQ(step(), Plain(step)) << count;
  }
}

}  // namespace
}  // namespace maneuver::kernels::adamw_step_test
