#include "model/kernels/set_pooling.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/unit/model/kernels/kernel_test.h"

namespace maneuver::kernels::set_pooling_test {
namespace {

class SetPoolingTest : public KernelTest {};
MANEUVER_TEST_EACH_TARGET(SetPoolingTest);

TEST_P(SetPoolingTest, AHeadWeightsItsOwnChannels) {
  const std::vector<float> elements = {1, 2, 3, 4,  //
                                       5, 0, 1, 8};
  const float ln3 = std::log(3.0f);
  const std::vector<float> scores = {0, ln3,  // weights 1/2 and 3/4
                                     0, 0};
  std::vector<float> pooled(8, -1.0f);
  PoolSet(elements.data(), scores.data(), 2, {4, 2}, pooled.data());
  const double expected[] = {3, 1, 2.5, 5, 5, 2, 3, 8};
  for (size_t c = 0; c < 8; ++c) EXPECT_NEAR(pooled[c], expected[c], 1e-6) << c;
}

TEST_P(SetPoolingTest, AnEmptySetIsZero) {
  std::vector<float> pooled(6, -1.0f);
  PoolSet(nullptr, nullptr, 0, {3, 1}, pooled.data());
  for (const float value : pooled) EXPECT_EQ(value, 0.0f);
}

TEST_P(SetPoolingTest, LargeScoresDoNotOverflow) {
  const std::vector<float> elements = {1, 7};
  const std::vector<float> scores = {500, -500};
  std::vector<float> pooled(2);
  PoolSet(elements.data(), scores.data(), 2, {1, 1}, pooled.data());
  EXPECT_EQ(pooled[0], 1.0f);
  EXPECT_EQ(pooled[1], 7.0f);
}

TEST_P(SetPoolingTest, PoolsWithTheBitsOfPlainAndWritesNothingElse) {
  for (const SetShape shape : {SetShape{32, 2}, {96, 4}, {64, 1}, {21, 3}, {5, 5}}) {
    for (const int count : {1, 2, 6, 12, 70}) {
      std::vector<float> elements =
          RandomValues(static_cast<size_t>(count) * static_cast<size_t>(shape.width), 1);
      for (float& element : elements) element = std::max(element, 0.0f);
      const auto scores =
          RandomValues(static_cast<size_t>(count) * static_cast<size_t>(shape.heads), 2);
      const auto pool = [&] {
        std::vector<float> pooled(2 * static_cast<size_t>(shape.width) + 1, -1.0f);
        PoolSet(elements.data(), scores.data(), count, shape, pooled.data());
        return pooled;
      };
      const auto pooled = pool();
      ASSERT_EQ(pooled, Plain(pool)) << shape.width << " " << count;
      ASSERT_EQ(pooled.back(), -1.0f);
    }
  }
}

TEST_P(SetPoolingTest, AddsTwoAndRectifiesWithTheBitsOfPlain) {
  constexpr size_t kMost = 40;
  const auto a = RandomValues(kMost, 3);
  const auto b = RandomValues(kMost, 4);
  for (int count = 0; count < static_cast<int>(kMost); ++count) {
    const auto add = [&] {
      std::vector<float> y = RandomValues(kMost, 5);
      AddTwoAndRectify(a.data(), b.data(), count, y.data());
      return y;
    };
    ASSERT_EQ(add(), Plain(add)) << count;
  }
  std::vector<float> y = {1.0f, -3.0f};
  AddTwoAndRectify(std::vector{0.5f, 1.0f}.data(), std::vector{0.25f, 1.0f}.data(), 2, y.data());
  EXPECT_EQ(y, (std::vector{1.75f, 0.0f}));
}

TEST_P(SetPoolingTest, WhatIsNotANumberStays) {
  for (const size_t count : {1u, 8u, 21u}) {
    const std::vector<float> none(count, 0.0f);
    std::vector<float> y(count, std::nanf(""));
    AddTwoAndRectify(none.data(), none.data(), static_cast<int>(count), y.data());
    for (const float value : y) EXPECT_TRUE(std::isnan(value)) << count;
  }
}

}  // namespace
}  // namespace maneuver::kernels::set_pooling_test
