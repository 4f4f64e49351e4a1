// The convolution against plain. Plain is held against PyTorch in
// model/learning/raster_convolution_test.cc.

#include "model/kernels/nonzero_convolution.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "tests/unit/model/kernels/kernel_test.h"

namespace maneuver::kernels::nonzero_convolution_test {
namespace {

std::vector<uint8_t> RandomRaster(const ConvolutionShape& shape) {
  std::mt19937 random(7);
  std::vector<uint8_t> raster(static_cast<size_t>(shape.height * shape.width * shape.channels));
  for (uint8_t& byte : raster) {
    byte = random() % 10 == 0 ? static_cast<uint8_t>(1 + random() % 255) : 0;
  }
  return raster;
}

class NonzeroConvolutionTest : public KernelTest {};
MANEUVER_TEST_EACH_TARGET(NonzeroConvolutionTest);

TEST_P(NonzeroConvolutionTest, FindsEveryNonzeroByte) {
  const auto bytes = RandomRaster({.height = 1, .width = 300, .channels = 1});
  for (size_t count = 0; count <= bytes.size(); ++count) {
    std::vector<uint64_t> words((count + 63) / 64 + 1, ~uint64_t{0});
    FindNonzeroBytes(bytes.data(), count, words.data());
    for (size_t i = 0; i < 64 * (words.size() - 1); ++i) {
      ASSERT_EQ(words[i / 64] >> (i % 64) & 1, i < count && bytes[i] != 0 ? 1u : 0u);
    }
    ASSERT_EQ(words.back(), ~uint64_t{0});
  }
}

TEST_P(NonzeroConvolutionTest, HasTheBitsOfPlain) {
  for (const int64_t outputs : {5, 8, 24, 33, 64}) {
    const ConvolutionShape shape = {
        .height = 17, .width = 13, .channels = 5, .outputs = outputs, .kernel = 3, .stride = 2};
    const auto raster = RandomRaster(shape);
    const auto cells = static_cast<size_t>(shape.output_height() * shape.output_width());
    const auto weights =
        static_cast<size_t>(3 * 3 * shape.channels * NonzeroValues::VectorMultiple(outputs));
    const auto convolve = [&] {
      const NonzeroValues values(shape, raster.data());
      const auto weight = RandomValues(weights, 1);
      std::vector<float> output(cells * static_cast<size_t>(outputs), -7.0F);
      values.Convolve(shape, weight.data(), output.data());
      return output;
    };
    const auto learn = [&] {
      const NonzeroValues values(shape, raster.data());
      const auto gradient = RandomValues(cells * static_cast<size_t>(outputs), 2);
      std::vector<float> weight_gradient(weights, 0.25F);
      values.AddWeightGradient(shape, gradient.data(), weight_gradient.data());
      return weight_gradient;
    };
    ASSERT_EQ(convolve(), Plain(convolve)) << outputs;
    ASSERT_EQ(learn(), Plain(learn)) << outputs;
  }
}

}  // namespace
}  // namespace maneuver::kernels::nonzero_convolution_test
