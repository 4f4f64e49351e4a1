// The convolution against plain. Plain is held against PyTorch in
// model/learning/raster_convolution_test.cc.

#include "model/kernels/nonzero_convolution.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "tests/unit/model/kernels/kernel_test.h"

namespace maneuver::kernels::nonzero_convolution_test {
namespace {

// One value in ten, at random.
NonzeroValues RandomRaster(const ConvolutionShape& shape) {
  std::mt19937 random(7);
  NonzeroValues raster;
  raster.rows.push_back(0);
  for (int64_t row = 0; row < shape.height; ++row) {
    for (int column = 0; column < shape.width; ++column) {
      const int begin = raster.count;
      for (int64_t channel = 0; channel < shape.channels; ++channel) {
        if (random() % 10 != 0) continue;
        raster.values.push_back({static_cast<int32_t>(column * shape.channels + channel),
                                 static_cast<float>(1 + random() % 255)});
        ++raster.count;
      }
      if (raster.count > begin) raster.pixels.push_back({column, begin, raster.count});
    }
    raster.rows.push_back(static_cast<int32_t>(raster.pixels.size()));
  }
  return raster;
}

class NonzeroConvolutionTest : public KernelTest {};
MANEUVER_TEST_EACH_TARGET(NonzeroConvolutionTest);

TEST_P(NonzeroConvolutionTest, HasTheBitsOfPlain) {
  for (const int64_t outputs : {5, 8, 24, 33, 64}) {
    const ConvolutionShape shape = {
        .height = 17, .width = 13, .channels = 5, .outputs = outputs, .kernel = 3, .stride = 2};
    const NonzeroValues raster = RandomRaster(shape);
    const auto cells = static_cast<size_t>(shape.output_height() * shape.output_width());
    const auto weights = static_cast<size_t>(3 * 3 * shape.channels * PaddedOutputs(outputs));
    const auto convolve = [&] {
      const auto weight = RandomValues(weights, 1);
      std::vector<float> output(cells * static_cast<size_t>(outputs), -7.0F);
      ConvolveNonzero(shape, raster, weight.data(), output.data());
      return output;
    };
    const auto learn = [&] {
      const auto gradient = RandomValues(cells * static_cast<size_t>(outputs), 2);
      std::vector<float> weight_gradient(weights, 0.25F);
      AddNonzeroWeightGradient(shape, raster, gradient.data(), weight_gradient.data());
      return weight_gradient;
    };
    ASSERT_EQ(convolve(), Plain(convolve)) << outputs;
    ASSERT_EQ(learn(), Plain(learn)) << outputs;
  }
}

}  // namespace
}  // namespace maneuver::kernels::nonzero_convolution_test
