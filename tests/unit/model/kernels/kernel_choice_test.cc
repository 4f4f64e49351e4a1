#include "model/kernels/kernel_choice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include "model/kernels/bf16.h"

namespace maneuver::kernels::kernel_choice_test {
namespace {

TEST(KernelChoiceTest, RunsTheBestTargetUnlessPlainIsChosen) {
  const std::string best = KernelTarget();
  EXPECT_NE(best, "plain");
  ChooseKernels(KernelChoice::kPlain);
  EXPECT_TRUE(UsesPlainKernels());
  EXPECT_EQ(KernelTarget(), "plain");
  ChooseKernels(KernelChoice::kAuto);
  EXPECT_FALSE(UsesPlainKernels());
  EXPECT_EQ(KernelTarget(), best);
}

TEST(KernelChoiceTest, EachTargetCanBeForced) {
  const auto targets = KernelTargets();
  EXPECT_EQ(targets.front(), "plain");
  ASSERT_GE(targets.size(), 2u);
  for (const std::string& target : targets) {
    ForceKernelTargetForTest(target);
    EXPECT_EQ(KernelTarget(), target);
    EXPECT_EQ(KernelTargets(), targets);
  }
  ForceKernelTargetForTest(targets[1]);
}

TEST(Bf16Test, RoundsAsEigenDoes) {
  for (const float value :
       {0.0F, -0.0F, 1.0F, 1.00390625F, 1.01171875F, -3.1415927F, 1e-40F, 3.4e38F,
        std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::max()}) {
    EXPECT_EQ(ToBf16(value), Eigen::bfloat16(value).value) << value;
    EXPECT_EQ(FromBf16(ToBf16(value)), static_cast<float>(Eigen::bfloat16(value)));
  }
  EXPECT_TRUE(std::isnan(FromBf16(ToBf16(std::numeric_limits<float>::quiet_NaN()))));
}

}  // namespace
}  // namespace maneuver::kernels::kernel_choice_test
