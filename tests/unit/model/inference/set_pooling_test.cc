#include "model/inference/set_pooling.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace maneuver::inference::set_pooling_test {
namespace {

TEST(SetPoolingTest, AHeadWeightsItsOwnChannels) {
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

TEST(SetPoolingTest, AnEmptySetIsZero) {
  std::vector<float> pooled(6, -1.0f);
  PoolSet(nullptr, nullptr, 0, {3, 1}, pooled.data());
  for (const float value : pooled) EXPECT_EQ(value, 0.0f);
}

TEST(SetPoolingTest, LargeScoresDoNotOverflow) {
  const std::vector<float> elements = {1, 7};
  const std::vector<float> scores = {500, -500};
  std::vector<float> pooled(2);
  PoolSet(elements.data(), scores.data(), 2, {1, 1}, pooled.data());
  EXPECT_EQ(pooled[0], 1.0f);
  EXPECT_EQ(pooled[1], 7.0f);
}

}  // namespace
}  // namespace maneuver::inference::set_pooling_test
