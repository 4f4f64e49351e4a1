// The passes against plain. What they add up to, batch normalisation with its gradient, is held
// against PyTorch in model/learning/batch_norm_relu_test.cc.

#include "model/kernels/batch_norm_passes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "tests/unit/model/kernels/kernel_test.h"

namespace maneuver::kernels::batch_norm_passes_test {
namespace {

// All that the passes write for random numbers.
struct Written {
  Written(int64_t cells, int64_t channels)
      : first(static_cast<size_t>(channels), 0.5), second(first) {
    const auto grid = static_cast<size_t>(cells * channels);
    const auto width = static_cast<size_t>(channels);
    const auto x = RandomValues(grid, 1);
    const auto y_gradient = RandomValues(grid, 2);
    const auto scale = RandomValues(width, 3);
    const auto offset = RandomValues(width, 4);
    const auto mean = RandomValues(width, 5);
    const auto constant = RandomValues(width, 6);
    const ChannelMap map = {scale.data(), offset.data()};
    y.resize(grid + 1, -7.0F);
    x_gradient.resize(grid + 1, -7.0F);
    AddMoments(cells, channels, x.data(), mean.data(), {first.data(), second.data()});
    NormalizeRelu(cells, channels, x.data(), map, y.data());
    AddGradientSums(cells, channels, x.data(), y_gradient.data(), map, mean.data(),
                    {second.data(), first.data()});
    PassGradientBack(cells, channels, x.data(), y_gradient.data(), map, mean.data(),
                     constant.data(), x_gradient.data());
  }
  bool operator==(const Written&) const = default;

  std::vector<double> first;
  std::vector<double> second;
  std::vector<float> y;
  std::vector<float> x_gradient;
};

class BatchNormPassesTest : public KernelTest {};
MANEUVER_TEST_EACH_TARGET(BatchNormPassesTest);

TEST_P(BatchNormPassesTest, HaveTheBitsOfPlain) {
  for (const int64_t channels : {1, 5, 8, 24, 33}) {
    for (const int64_t cells : {1, 127, 128, 300}) {
      const auto write = [=] { return Written(cells, channels); };
      const Written written = write();
      ASSERT_EQ(written, Plain(write)) << cells << " cells of " << channels;
      ASSERT_EQ(written.y.back(), -7.0F);
      ASSERT_EQ(written.x_gradient.back(), -7.0F);
    }
  }
}

TEST_P(BatchNormPassesTest, KeepNaN) {
  const std::vector<float> x(9, std::numeric_limits<float>::quiet_NaN());
  const std::vector<float> ones(9, 1.0F);
  std::vector<float> y(9);
  NormalizeRelu(1, 9, x.data(), {ones.data(), ones.data()}, y.data());
  for (const float value : y) EXPECT_TRUE(std::isnan(value));
}

}  // namespace
}  // namespace maneuver::kernels::batch_norm_passes_test
