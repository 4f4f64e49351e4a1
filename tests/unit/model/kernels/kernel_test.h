// Tests that run once for each kernel target of this binary that the processor has, and once with
// the plain loops.

#ifndef MANEUVER_TESTS_UNIT_MODEL_KERNELS_KERNEL_TEST_H_
#define MANEUVER_TESTS_UNIT_MODEL_KERNELS_KERNEL_TEST_H_

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "model/kernels/kernel_choice.h"

namespace maneuver::kernels {

// The parameter is the target that is in force during the test.
class KernelTest : public testing::TestWithParam<std::string> {
 protected:
  KernelTest() { ForceKernelTargetForTest(GetParam()); }
  ~KernelTest() override { ForceKernelTargetForTest(KernelTargets().at(1)); }

  // Returns what `compute` returns with plain kernels.
  template <typename Compute>
  static auto Plain(const Compute& compute) {
    ForceKernelTargetForTest("plain");
    auto result = compute();
    ForceKernelTargetForTest(GetParam());
    return result;
  }
};

#define MANEUVER_TEST_EACH_TARGET(suite)                                       \
  INSTANTIATE_TEST_SUITE_P(Targets, suite, testing::ValuesIn(KernelTargets()), \
                           [](const auto& target) { return target.param; })

inline std::vector<float> RandomValues(size_t count, uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  std::vector<float> values(count);
  for (float& value : values) value = normal(random);
  return values;
}

}  // namespace maneuver::kernels

#endif  // MANEUVER_TESTS_UNIT_MODEL_KERNELS_KERNEL_TEST_H_
