// Batch normalisation and ReLU in one against PyTorch's two, in doubles.

#include "model/learning/autograd/batch_norm_relu.h"

#include <ATen/ATen.h>
#include <ATen/Parallel.h>
#include <gtest/gtest.h>

#include <limits>
#include <vector>

namespace maneuver::learning::batch_norm_relu_test {
namespace {

struct Problem {
  const char* name;
  std::vector<int64_t> shape;  // [B, C, h, w]
  bool channels_last;
  double mean;          // of all channels, in deviations
  double running_mean;  // before
  int threads;
};

class BatchNormReluTest : public testing::Test {
 protected:
  ~BatchNormReluTest() override { at::set_num_threads(threads_); }
  const int threads_ = at::get_num_threads();
};
class BatchNormReluGridTest : public BatchNormReluTest,
                              public testing::WithParamInterface<Problem> {};
INSTANTIATE_TEST_SUITE_P(
    Grids, BatchNormReluGridTest,
    testing::Values(Problem{"Vectors", {8, 24, 16, 16}, true, 0.3, 0.3, 1},
                    Problem{"Threads", {64, 24, 32, 32}, true, 0.3, 0.3, 3},
                    Problem{"NoVector", {3, 5, 7, 9}, true, -0.4, 0.0, 1},
                    Problem{"ChannelsFirst", {4, 12, 9, 11}, false, 0.0, 0.0, 1},
                    Problem{"FarFromZero", {16, 16, 9, 9}, true, 300.0, -100.0, 1},
                    Problem{"OneCell", {2, 8, 1, 1}, true, 0.0, 0.0, 1}),
    [](const auto& problem) { return problem.param.name; });

BatchNorm RandomNorm(int64_t channels, double mean) {
  return {at::randn({channels}), at::randn({channels}), at::randn({channels}) * 0.1 + mean,
          at::rand({channels}) + 0.5};
}

BatchNorm InDoubles(const BatchNorm& norm) {
  return {norm.weight.detach().to(at::kDouble), norm.bias.detach().to(at::kDouble),
          norm.running_mean.to(at::kDouble), norm.running_var.to(at::kDouble)};
}

double Difference(const at::Tensor& a, const at::Tensor& b) {
  return (a.to(at::kDouble) - b).abs().max().item<double>() / (1.0 + b.abs().max().item<double>());
}

TEST_P(BatchNormReluGridTest, AgreesWithPyTorch) {
  const Problem& p = GetParam();
  at::set_num_threads(p.threads);
  at::manual_seed(1);
  at::Tensor x = at::randn(p.shape) + p.mean;
  if (p.channels_last) x = x.contiguous(at::MemoryFormat::ChannelsLast);
  BatchNorm norm = RandomNorm(p.shape[1], p.running_mean);
  BatchNorm exact_norm = InDoubles(norm);
  at::Tensor exact_x = x.to(at::kDouble);
  for (at::Tensor* learned :
       {&x, &norm.weight, &norm.bias, &exact_x, &exact_norm.weight, &exact_norm.bias}) {
    learned->requires_grad_();
  }

  const at::Tensor y = BatchNormRelu(x, norm);
  const at::Tensor exact =
      at::batch_norm(exact_x, exact_norm.weight, exact_norm.bias, exact_norm.running_mean,
                     exact_norm.running_var, true, kBatchNormMomentum, kBatchNormEpsilon, false)
          .relu();
  // A float far from 0 has so many digits fewer.
  const double most = p.mean > 100.0 ? 1e-4 : 5e-6;
  EXPECT_LE(Difference(y, exact), most);
  EXPECT_LE(Difference(norm.running_mean, exact_norm.running_mean), 1e-6);
  EXPECT_LE(Difference(norm.running_var, exact_norm.running_var), 1e-6);
  EXPECT_GT(exact.eq(0.0).sum().item<int64_t>(), 0);

  const at::Tensor gradient = at::randn_like(y);
  y.backward(gradient);
  exact.backward(gradient.to(at::kDouble));
  EXPECT_LE(Difference(x.grad(), exact_x.grad()), most);
  EXPECT_LE(Difference(norm.weight.grad(), exact_norm.weight.grad()), 5.0 * most);
  EXPECT_LE(Difference(norm.bias.grad(), exact_norm.bias.grad()), most);
}

// A micro-batch may have one example, and the last grid one cell.
TEST_F(BatchNormReluTest, ASingleCellLeavesTheRunningVarianceAndIsFinite) {
  at::manual_seed(1);
  for (const auto& normalize : {BatchNormOfBatch, BatchNormRelu}) {
    const at::Tensor x = at::randn({1, 8, 1, 1}).requires_grad_();
    const BatchNorm norm = RandomNorm(8, 0.0);
    const BatchNorm before = {norm.weight, norm.bias, norm.running_mean.clone(),
                              norm.running_var.clone()};
    const at::Tensor y = normalize(x, norm);
    y.sum().backward();
    EXPECT_TRUE(y.isfinite().all().item<bool>());
    EXPECT_TRUE(x.grad().isfinite().all().item<bool>());
    EXPECT_TRUE(at::equal(norm.running_var, before.running_var));
    const at::Tensor mean =
        before.running_mean + kBatchNormMomentum * (x.detach().reshape({8}) - before.running_mean);
    EXPECT_LE(Difference(norm.running_mean, mean.to(at::kDouble)), 1e-6);
  }
}

// A loss must not stay finite when something before it is not.
TEST_F(BatchNormReluTest, KeepsNaN) {
  at::manual_seed(1);
  at::Tensor x = at::randn({4, 8, 5, 5});
  x[2][3][1][1] = std::numeric_limits<float>::quiet_NaN();
  x.requires_grad_();
  const BatchNorm norm = RandomNorm(8, 0.0);
  const at::Tensor y = BatchNormRelu(x, norm);
  EXPECT_TRUE(y.select(1, 3).isnan().all().item<bool>());
  EXPECT_FALSE(y.select(1, 4).isnan().any().item<bool>());
  y.sum().backward();
  EXPECT_TRUE(x.grad().select(1, 3).isnan().all().item<bool>());
}

TEST_F(BatchNormReluTest, TheSameNumberOfThreadsGivesTheSameBits) {
  at::set_num_threads(3);
  at::manual_seed(1);
  const at::Tensor x = at::randn({64, 24, 16, 16}).contiguous(at::MemoryFormat::ChannelsLast);
  const BatchNorm norm = RandomNorm(24, 0.0);
  at::Tensor first;
  for (int i = 0; i < 5; ++i) {
    const at::Tensor again = x.clone().requires_grad_();
    BatchNormRelu(again, norm).square().sum().backward();
    if (i == 0) first = again.grad();
    EXPECT_TRUE(at::equal(again.grad(), first));
  }
}

}  // namespace
}  // namespace maneuver::learning::batch_norm_relu_test
