// The convolution over nonzero values against PyTorch's over all of them, in doubles.

#include "model/learning/autograd/raster_convolution.h"

#include <ATen/ATen.h>
#include <ATen/Parallel.h>
#include <gtest/gtest.h>

#include <string>

#include "tests/unit/model/learning/raster_batch_of.h"

namespace maneuver::learning::raster_convolution_test {
namespace {

struct Problem {
  const char* name;
  int64_t height, width, channels, outputs, kernel, stride;
  double nonzero;  // share
};

class RasterConvolutionTest : public testing::TestWithParam<Problem> {};
INSTANTIATE_TEST_SUITE_P(Shapes, RasterConvolutionTest,
                         testing::Values(Problem{"Compact", 64, 64, 13, 24, 3, 2, 0.08},
                                         Problem{"Odd", 37, 29, 7, 5, 3, 2, 0.1},
                                         Problem{"SmallerThanTheKernel", 2, 5, 3, 9, 7, 2, 0.2},
                                         Problem{"LargeKernel", 30, 41, 5, 64, 7, 2, 0.1},
                                         Problem{"EveryCell", 11, 13, 4, 33, 3, 1, 0.2},
                                         Problem{"OneChannel", 16, 40, 1, 16, 1, 3, 0.2},
                                         Problem{"AllZero", 9, 10, 3, 8, 3, 2, 0.0},
                                         Problem{"TooManyNonzero", 20, 21, 5, 24, 3, 2, 0.6}),
                         [](const auto& problem) { return problem.param.name; });

double Difference(const at::Tensor& a, const at::Tensor& b) {
  return (a.to(at::kDouble) - b).abs().max().item<double>();
}

TEST_P(RasterConvolutionTest, AgreesWithPyTorch) {
  const Problem& p = GetParam();
  constexpr int64_t kBatch = 5;
  at::manual_seed(1);
  const std::vector<int64_t> shape = {kBatch, p.height, p.width, p.channels};
  const at::Tensor rasters =
      (at::rand(shape) < p.nonzero).to(at::kByte) * at::randint(1, 256, shape, at::kByte);
  at::Tensor weight = at::randn({p.outputs, p.channels, p.kernel, p.kernel})
                          .contiguous(at::MemoryFormat::ChannelsLast)
                          .requires_grad_();
  at::Tensor exact_weight = weight.detach().to(at::kDouble).requires_grad_();

  const RasterBatch batch = RasterBatchOf(rasters);
  EXPECT_TRUE(batch.Dense().equal(rasters));
  const at::Tensor output = ConvolveRasters(batch, weight, p.stride);
  const at::Tensor exact = at::conv2d(rasters.permute({0, 3, 1, 2}).to(at::kDouble) / 255.0,
                                      exact_weight, {}, p.stride, p.kernel / 2);
  ASSERT_EQ(output.sizes(), exact.sizes());
  EXPECT_TRUE(output.is_contiguous(at::MemoryFormat::ChannelsLast));
  EXPECT_LE(Difference(output, exact), 1e-5);

  const at::Tensor gradient = at::randn_like(output);
  output.backward(gradient);
  exact.backward(gradient.to(at::kDouble));
  EXPECT_LE(Difference(weight.grad(), exact_weight.grad()), 1e-4);
  EXPECT_EQ(exact_weight.grad().abs().max().item<double>() > 0.1, p.nonzero > 0.0);
}

TEST(RasterConvolutionTest, ThreadsShareTheBatch) {
  const int threads = at::get_num_threads();
  const RasterBatch rasters = RasterBatchOf((at::rand({9, 20, 22, 5}) < 0.1).to(at::kByte) * 255);
  at::Tensor weight = at::randn({24, 5, 3, 3}).requires_grad_();
  at::Tensor alone;
  for (const int count : {1, 3}) {
    at::set_num_threads(count);
    ConvolveRasters(rasters, weight, 2).square().sum().backward();
    if (count == 1) {
      alone = weight.grad().clone();
      weight.mutable_grad() = at::Tensor();
    }
  }
  at::set_num_threads(threads);
  EXPECT_LE((weight.grad() - alone).abs().max().item<double>(),
            1e-5 * alone.abs().max().item<double>());
}

}  // namespace
}  // namespace maneuver::learning::raster_convolution_test
