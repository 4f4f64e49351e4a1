#include "model/kernels/rescale.h"

#include <gtest/gtest.h>

#include <vector>

namespace maneuver::kernels::rescale_test {
namespace {

TEST(RescaleTest, MultipliesAddsTheMeanAndThenTheShift) {
  const std::vector<float> x = {1.0F, 2.0F, 3.0F, -1.0F, 0.5F, 0.0F};
  const std::vector<double> stddev = {2.0, 3.0, 0.1};
  const std::vector<double> mean = {10.0, 20.0, 0.2};
  const std::vector<double> shift = {0.25, -1.0, 0.3};
  std::vector<double> y(6);
  Rescale(x.data(), 2, 3, stddev.data(), mean.data(), nullptr, y.data());
  EXPECT_EQ(y, (std::vector<double>{12.0, 26.0, 3.0 * 0.1 + 0.2, 8.0, 21.5, 0.2}));
  Rescale(x.data(), 2, 3, stddev.data(), mean.data(), shift.data(), y.data());
  EXPECT_EQ(y, (std::vector<double>{12.25, 25.0, 3.0 * 0.1 + 0.2 + 0.3, 8.25, 20.5, 0.2 + 0.3}));
}

}  // namespace
}  // namespace maneuver::kernels::rescale_test
