#include "model/kernels/first_layer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "model/kernels/bf16.h"
#include "tests/unit/model/kernels/kernel_test.h"

namespace maneuver::kernels::first_layer_test {
namespace {

// Channels of the output that fill whole vectors, half ones, and more than are held at once.
constexpr int kOutputs[] = {8, 16, 24, 40, 64, 72, 176};

class FirstLayerKernelTest : public KernelTest {};
MANEUVER_TEST_EACH_TARGET(FirstLayerKernelTest);

TEST_P(FirstLayerKernelTest, WidensEveryByte) {
  std::vector<uint8_t> bytes(256 + 7);
  std::iota(bytes.begin(), bytes.end(), uint8_t{0});
  for (size_t count = 0; count <= bytes.size(); count += 13) {
    std::vector<float> floats(count + 1, -1.0F);
    FirstLayerKernelInForce().widen(bytes.data(), static_cast<int>(count), floats.data());
    for (size_t i = 0; i < count; ++i) ASSERT_EQ(floats[i], static_cast<float>(bytes[i]));
    ASSERT_EQ(floats[count], -1.0F);
  }
}

// Two kernel rows of 3 x 3 values, read by up to four pixels two input pixels apart.
struct MapProblem {
  explicit MapProblem(int some_outputs) : outputs(some_outputs) {
    taps.inputs[0] = input.data();
    taps.inputs[1] = input.data() + kRowPixels * 3;
    taps.weights[0] = weights.data();
    taps.weights[1] = weights.data() + ptrdiff_t{kValues} * outputs;
    taps.rows = 2;
    taps.values = kValues;
    taps.places = places.data();
    taps.stride = 2;
    taps.outputs = outputs;
  }

  std::vector<float> Sum(int pixels) const {
    std::vector<float> sums(static_cast<size_t>(pixels * outputs) + 1, -7.0F);
    FirstLayerKernelInForce().sum_map(taps, bias.data(), pixels, sums.data());
    EXPECT_EQ(sums.back(), -7.0F);
    sums.pop_back();
    return sums;
  }

  static constexpr int kRowPixels = 12;
  static constexpr int kValues = 9;
  const int outputs;
  std::vector<int> places = {0, 12, 24, 1, 13, 25, 2, 14, 26};
  std::vector<float> input = RandomValues(2 * 3 * kRowPixels, 1);
  std::vector<float> weights = RandomValues(static_cast<size_t>(2 * kValues * outputs), 2);
  std::vector<float> bias = RandomValues(static_cast<size_t>(outputs), 3);
  MapTaps taps{};
};

TEST_P(FirstLayerKernelTest, SumsEveryProductOfTheMap) {
  const MapProblem problem(24);
  const auto sums = problem.Sum(kMapGroup);
  for (int pixel = 0; pixel < kMapGroup; ++pixel) {
    for (int o = 0; o < problem.outputs; ++o) {
      double sum = problem.bias[static_cast<size_t>(o)];
      for (int row = 0; row < 2; ++row) {
        for (int value = 0; value < MapProblem::kValues; ++value) {
          // Value c + 3 x is channel c of the x-th pixel.
          const int place = (row * 3 + value % 3) * MapProblem::kRowPixels + value / 3 + 2 * pixel;
          sum += double{problem.input[static_cast<size_t>(place)]} *
                 problem.weights[static_cast<size_t>(
                     (row * MapProblem::kValues + value) * problem.outputs + o)];
        }
      }
      ASSERT_NEAR(sums[static_cast<size_t>(pixel * problem.outputs + o)], sum, 1e-5);
    }
  }
}

TEST_P(FirstLayerKernelTest, SumsTheMapWithTheBitsOfPlainAndOfAPixelAlone) {
  for (const int outputs : kOutputs) {
    const MapProblem problem(outputs);
    const auto together = problem.Sum(kMapGroup);
    ASSERT_EQ(together, Plain([&] { return problem.Sum(kMapGroup); })) << outputs;
    const auto alone = problem.Sum(1);
    ASSERT_TRUE(std::equal(alone.begin(), alone.end(), together.begin())) << outputs;
  }
}

TEST_P(FirstLayerKernelTest, AddsValuesWithTheBitsOfPlain) {
  constexpr int kOrigin = 15;  // of the third pixel of a row
  for (const int outputs : kOutputs) {
    const auto weights = RandomValues(static_cast<size_t>(5 * outputs), 4);
    const std::vector<NonzeroValue> values = {{.place = kOrigin + 0, .value = 1.0F},
                                              {.place = kOrigin + 2, .value = 77.0F},
                                              {.place = kOrigin + 4, .value = 255.0F}};
    const auto before = RandomValues(static_cast<size_t>(outputs) + 1, 5);
    const auto add = [&] {
      std::vector<float> sums = before;
      FirstLayerKernelInForce().add_values(values, kOrigin, weights.data(), outputs, sums.data());
      return sums;
    };
    const auto sums = add();
    ASSERT_EQ(sums, Plain(add)) << outputs;
    ASSERT_EQ(sums.back(), before.back());
    for (int o = 0; o < outputs; ++o) {
      double sum = before[static_cast<size_t>(o)];
      for (const NonzeroValue& each : values) {
        sum +=
            double{each.value} * weights[static_cast<size_t>((each.place - kOrigin) * outputs + o)];
      }
      ASSERT_NEAR(sums[static_cast<size_t>(o)], sum, 1e-3);
    }
  }
}

TEST_P(FirstLayerKernelTest, StoresRowsWithReluAndRoundsThemToBf16) {
  auto sums = RandomValues(77, 6);
  sums[3] = std::numeric_limits<float>::quiet_NaN();
  sums[70] = std::numeric_limits<float>::quiet_NaN();
  sums[5] = 1.00390625F;  // half way between two bf16 numbers, as is the next
  sums[6] = 1.01171875F;
  sums[7] = std::numeric_limits<float>::infinity();
  sums[8] = 1e-40F;
  for (const bool relu : {false, true}) {
    for (size_t count = 0; count <= sums.size(); count += 7) {
      std::vector<float> row(count + 1, -7.0F);
      std::vector<uint16_t> narrow(count + 1, 7);
      const auto n = static_cast<ptrdiff_t>(count);
      FirstLayerKernelInForce().store(sums.data(), n, relu, row.data());
      FirstLayerKernelInForce().store_bf16(sums.data(), n, relu, narrow.data());
      for (size_t i = 0; i < count; ++i) {
        if (std::isnan(sums[i])) {
          ASSERT_TRUE(std::isnan(row[i]) && std::isnan(FromBf16(narrow[i])));
          continue;
        }
        ASSERT_EQ(row[i], relu ? std::max(sums[i], 0.0F) : sums[i]);
        ASSERT_EQ(narrow[i], ToBf16(row[i])) << sums[i];
      }
      ASSERT_EQ(row[count], -7.0F);
      ASSERT_EQ(narrow[count], 7);
    }
  }
}

}  // namespace
}  // namespace maneuver::kernels::first_layer_test
