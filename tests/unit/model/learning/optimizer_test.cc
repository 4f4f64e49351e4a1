// AdamW against its formulas, number by number, in doubles.

#include "model/learning/optimizer.h"

#include <ATen/ATen.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <vector>

namespace maneuver::learning::optimizer_test {
namespace {

constexpr double kRate = 0.01;
constexpr double kDecay = 0.1;
constexpr int kSteps = 30;

// Algorithm 2 of the paper, for one number.
class Number {
 public:
  explicit Number(double value) : value_(value) {}
  double value() const { return value_; }

  void Step(double gradient, double rate, double decay) {
    ++steps_;
    m_ = 0.9 * m_ + 0.1 * gradient;
    v_ = 0.999 * v_ + 0.001 * gradient * gradient;
    const double m = m_ / (1.0 - std::pow(0.9, steps_));
    const double v = v_ / (1.0 - std::pow(0.999, steps_));
    value_ -= rate * (m / (std::sqrt(v) + 1e-8) + decay * value_);
  }

 private:
  double value_;
  double m_ = 0.0;
  double v_ = 0.0;
  int steps_ = 0;
};

struct Layout {
  const char* name;
  at::ScalarType type;
  std::vector<int64_t> shape;
  // How parameter and gradient lie in memory.
  std::function<at::Tensor(const at::Tensor&)> parameter;
  std::function<at::Tensor(const at::Tensor&)> gradient;
};

at::Tensor AsItIs(const at::Tensor& tensor) { return tensor.clone(); }
at::Tensor ChannelsLast(const at::Tensor& tensor) {
  return tensor.contiguous(at::MemoryFormat::ChannelsLast);
}

class AdamWTest : public testing::TestWithParam<Layout> {};
INSTANTIATE_TEST_SUITE_P(
    Layouts, AdamWTest,
    testing::Values(
        // More numbers than a thread takes, and not a multiple of anything.
        Layout{"Matrix", at::kFloat, {251, 263}, AsItIs, AsItIs},
        Layout{"ChannelsLast", at::kFloat, {24, 13, 3, 3}, ChannelsLast, ChannelsLast},
        Layout{"GradientLiesOtherwise", at::kFloat, {24, 13, 3, 3}, AsItIs, ChannelsLast},
        Layout{"Vector", at::kFloat, {7}, AsItIs, AsItIs},
        Layout{"Doubles", at::kDouble, {31, 5}, AsItIs, AsItIs}),
    [](const auto& layout) { return layout.param.name; });

TEST_P(AdamWTest, FollowsItsFormulas) {
  const Layout& layout = GetParam();
  at::manual_seed(1);
  const at::Tensor start = at::randn(layout.shape, layout.type);
  const at::Tensor parameter = layout.parameter(start).requires_grad_();
  AdamW optimizer;
  optimizer.Add({parameter}, kRate, kDecay);
  const at::Tensor begin = start.to(at::kDouble).contiguous();
  std::vector<Number> numbers;
  for (int64_t i = 0; i < begin.numel(); ++i) numbers.emplace_back(begin.data_ptr<double>()[i]);

  for (int step = 0; step < kSteps; ++step) {
    const at::Tensor gradient = at::randn(layout.shape, layout.type);
    parameter.mutable_grad() = layout.gradient(gradient);
    const double share = 1.0 / (1 + step);
    optimizer.Step(share);
    EXPECT_FALSE(parameter.grad().defined());
    const at::Tensor gradients = gradient.to(at::kDouble).contiguous();
    for (size_t i = 0; i < numbers.size(); ++i) {
      numbers[i].Step(gradients.data_ptr<double>()[i], share * kRate,
                      layout.shape.size() > 1 ? kDecay : 0.0);
    }
  }
  // Thirty roundings of values of up to four.
  const double tolerance = layout.type == at::kDouble ? 1e-12 : 1e-5;
  const at::Tensor end = parameter.detach().to(at::kDouble).contiguous();
  for (size_t i = 0; i < numbers.size(); ++i) {
    ASSERT_NEAR(end.data_ptr<double>()[i], numbers[i].value(), tolerance) << "number " << i;
  }
  EXPECT_GT((end - begin).abs().min().item<double>(), 0.0);
}

TEST(OptimizerTest, KeepsAParameterWithoutGradient) {
  const at::Tensor parameter = at::ones({3, 3}).requires_grad_();
  AdamW optimizer;
  optimizer.Add({parameter}, kRate, kDecay);
  optimizer.Step(1.0);
  EXPECT_TRUE(parameter.detach().equal(at::ones({3, 3})));
}

TEST(LearningRateShareTest, LearningRateWarmsUpAndThenFallsToZero) {
  EXPECT_LT(LearningRateShare(0, 100, 2000), 0.02);
  EXPECT_NEAR(LearningRateShare(100, 100, 2000), 1.0, 1e-9);
  EXPECT_NEAR(LearningRateShare(1050, 100, 2000), 0.5, 1e-9);
  EXPECT_LT(LearningRateShare(1999, 100, 2000), 1e-4);
}

}  // namespace
}  // namespace maneuver::learning::optimizer_test
