#include "model/kernels/cell_convolution.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "model/kernels/bf16.h"
#include "tests/unit/model/kernels/kernel_test.h"

namespace maneuver::kernels::cell_convolution_test {
namespace {

constexpr int kHeight = 9;
constexpr int kWidth = 11;

float ToFloat(float value) { return value; }
float ToFloat(uint16_t bits) { return FromBf16(bits); }

template <typename Value>
Value FromFloat(float value) {
  if constexpr (sizeof(Value) == 2) {
    return ToBf16(value);
  } else {
    return value;
  }
}

// A random input with its padding, and every third cell of the output.
struct Problem {
  Problem(const CellShape& cell_shape, int layer_stride) : shape(cell_shape), stride(layer_stride) {
    // Numbers that bf16 has, so that both precisions are held against the same.
    std::mt19937 random(7);
    std::normal_distribution<float> normal;
    const auto draw = [&] { return FromBf16(ToBf16(normal(random))); };
    weight.resize(static_cast<size_t>(shape.outputs * shape.inputs * shape.kernel * shape.kernel));
    std::ranges::generate(weight, draw);
    bias.resize(static_cast<size_t>(shape.outputs));
    std::ranges::generate(bias, [&] { return normal(random); });
    const int padding = shape.kernel / 2;
    row_values = (kWidth + 2 * padding) * shape.inputs;
    input.resize(static_cast<size_t>((kHeight + 2 * padding) * row_values));
    for (int row = 0; row < kHeight; ++row) {
      const auto begin = input.begin() + (row + padding) * row_values + padding * shape.inputs;
      std::generate_n(begin, kWidth * shape.inputs, draw);
    }
    const int width = (kWidth - 1) / stride + 1;
    count = width * ((kHeight - 1) / stride + 1);
    for (int cell = 0; cell < count; cell += 3) {
      cells.push_back({(cell / width * row_values + cell % width * shape.inputs) * stride,
                       ptrdiff_t{cell} * shape.outputs});
    }
  }

  double Expected(const Cell& cell, int output) const {
    double sum = bias[static_cast<size_t>(output)];
    const int kernel = shape.kernel;
    for (int y = 0; y < kernel; ++y) {
      for (int x = 0; x < kernel; ++x) {
        for (int i = 0; i < shape.inputs; ++i) {
          const auto w = ((output * shape.inputs + i) * kernel + y) * kernel + x;
          const auto place = cell.input + y * row_values + x * shape.inputs + i;
          sum += double{weight[static_cast<size_t>(w)]} * input[static_cast<size_t>(place)];
        }
      }
    }
    return shape.relu ? std::max(sum, 0.0) : sum;
  }

  // Returns what the convolution writes to a grid of -1.
  template <typename Input, typename Output>
  std::vector<float> Evaluate(std::span<const Cell> some) const {
    const CellConvolution convolution(shape, weight, bias, sizeof(Input) == 2, sizeof(Output) == 2);
    std::vector<Input> values(input.size());
    std::ranges::transform(input, values.begin(), FromFloat<Input>);
    std::vector<Output> output(static_cast<size_t>(count * shape.outputs),
                               FromFloat<Output>(-1.0F));
    convolution.Evaluate(values.data(), row_values, some, output.data());
    std::vector<float> floats(output.size());
    std::ranges::transform(output, floats.begin(), [](Output value) { return ToFloat(value); });
    return floats;
  }

  CellShape shape;
  int stride;
  ptrdiff_t row_values;
  int count;  // of all cells
  std::vector<float> weight;
  std::vector<float> bias;
  std::vector<float> input;
  std::vector<Cell> cells;
};

// Outputs fill 1, 2, 3, 4, 5 and 6 vectors with AVX-512, and twice as many with AVX2.
std::vector<Problem> Problems() {
  std::vector<Problem> problems;
  for (const bool relu : {true, false}) {
    problems.emplace_back(CellShape{3, 4, 16, relu}, 2);
    problems.emplace_back(CellShape{3, 6, 32, relu}, 1);
    problems.emplace_back(CellShape{3, 24, 48, relu}, 2);
    problems.emplace_back(CellShape{5, 8, 64, relu}, 2);
    problems.emplace_back(CellShape{1, 10, 80, relu}, 1);
    problems.emplace_back(CellShape{3, 64, 96, relu}, 2);
  }
  return problems;
}

class CellConvolutionTest : public KernelTest {
 protected:
  template <typename Input, typename Output>
  static void ExpectEveryProduct(const Problem& problem, double tolerance) {
    const auto output = problem.Evaluate<Input, Output>(problem.cells);
    std::vector<bool> written(output.size());
    for (const Cell& cell : problem.cells) {
      for (int o = 0; o < problem.shape.outputs; ++o) {
        const auto place = static_cast<size_t>(cell.output + o);
        const double expected = problem.Expected(cell, o);
        ASSERT_NEAR(output[place], expected, tolerance * (1.0 + std::abs(expected)));
        written[place] = true;
      }
    }
    for (size_t i = 0; i < output.size(); ++i) ASSERT_TRUE(written[i] || output[i] == -1.0F);
  }

  template <typename Input>
  static void ExpectTheSameAlone(const Problem& problem) {
    const auto together = problem.Evaluate<Input, float>(problem.cells);
    for (const Cell& cell : problem.cells) {
      const auto alone = problem.Evaluate<Input, float>({&cell, 1});
      for (int o = 0; o < problem.shape.outputs; ++o) {
        const auto place = static_cast<size_t>(cell.output + o);
        ASSERT_EQ(alone[place], together[place]);
      }
    }
  }
};
MANEUVER_TEST_EACH_TARGET(CellConvolutionTest);

TEST_P(CellConvolutionTest, SumsEveryProductAndWritesNothingElse) {
  for (const Problem& problem : Problems()) {
    ASSERT_TRUE(CellConvolution::Supports(problem.shape.inputs, problem.shape.outputs, false));
    ExpectEveryProduct<float, float>(problem, 1e-4);
  }
}

TEST_P(CellConvolutionTest, HasTheBitsOfPlain) {
  for (const Problem& problem : Problems()) {
    const auto evaluate = [&] { return problem.Evaluate<float, float>(problem.cells); };
    ASSERT_EQ(evaluate(), Plain(evaluate));
  }
}

TEST_P(CellConvolutionTest, KeepsTheBitsOfACellThatIsAlone) {
  ExpectTheSameAlone<float>(Problems().front());
  ExpectTheSameAlone<float>(Problems().back());
}

TEST_P(CellConvolutionTest, SumsEveryProductInBf16) {
  for (const Problem& problem : Problems()) {
    if (!CellConvolution::Supports(problem.shape.inputs, problem.shape.outputs, true)) {
      GTEST_SKIP() << "this processor does not multiply bf16";
    }
    ExpectEveryProduct<uint16_t, float>(problem, 1e-4);
    ExpectEveryProduct<uint16_t, uint16_t>(problem, 1.0 / 200);
  }
  ExpectTheSameAlone<uint16_t>(Problems().front());
}

TEST_P(CellConvolutionTest, SupportsChannelsThatFillVectorsAndPairs) {
  EXPECT_TRUE(CellConvolution::Supports(8, 32, false));
  EXPECT_TRUE(CellConvolution::Supports(7, 32, false));
  EXPECT_FALSE(CellConvolution::Supports(7, 32, true));
  EXPECT_FALSE(CellConvolution::Supports(8, 33, false));
}

}  // namespace
}  // namespace maneuver::kernels::cell_convolution_test
