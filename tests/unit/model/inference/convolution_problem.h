// Convolutions of random rasters, and what they give, product by product.

#ifndef MANEUVER_TESTS_UNIT_MODEL_INFERENCE_CONVOLUTION_PROBLEM_H_
#define MANEUVER_TESTS_UNIT_MODEL_INFERENCE_CONVOLUTION_PROBLEM_H_

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

#include "model/artifact/backbone_layers.h"
#include "model/inference/folded_convolution.h"
#include "tests/unit/model/scene/raster_of.h"

namespace maneuver::inference {

struct Problem {
  artifact::BackboneLayer layer;
  FoldedConvolution folded;
  std::vector<uint8_t> raster;  // [H, W, C]

  // Returns the raster, with 0xff in the padding of every fifth row, as if something had been
  // painted across its right end.
  scene::Raster Drawn() const {
    const artifact::GridSize& grid = layer.input;
    auto drawn = scene::RasterOf(grid.height, grid.width, grid.channels, raster);
    const int end = static_cast<int>(drawn.stride());
    for (int channel = 0; channel < grid.channels; ++channel) {
      for (int row = 0; row < grid.height; row += 5) {
        drawn.MarkNonzero(channel, row, drawn.BlocksOf(grid.width - 1, end - 1));
        std::fill(drawn.Row(channel, row) + grid.width, drawn.Row(channel, row) + end, 0xff);
      }
    }
    return drawn;
  }
};

// Returns a convolution with random weights of a random raster, of which one value in `one_in` is
// nonzero.
inline Problem MakeProblem(int kernel, int stride, int inputs, int outputs, int one_in,
                           int width = 22) {
  std::mt19937 random(kernel * 1000 + stride * 100 + inputs * 10 + outputs);
  Problem problem;
  artifact::BackboneLayer& layer = problem.layer;
  layer.kernel = kernel;
  layer.stride = stride;
  layer.input = {inputs, 17, width};
  layer.output = {outputs, (17 - 1) / stride + 1, (width - 1) / stride + 1};
  std::normal_distribution<float> normal;
  problem.folded.weight.resize(static_cast<size_t>(outputs) * inputs * kernel * kernel);
  problem.folded.bias.resize(outputs);
  for (float& weight : problem.folded.weight) weight = normal(random) / 255.0F;
  for (float& bias : problem.folded.bias) bias = normal(random);
  problem.raster.resize(static_cast<size_t>(layer.input.values()));
  for (uint8_t& byte : problem.raster) {
    byte = random() % one_in == 0 ? static_cast<uint8_t>(1 + random() % 255) : 0;
  }
  return problem;
}

// Returns one output value without its bias: adds its products one after the other.
//   first: the first input channel that counts
//   row, column, channel: of the output
inline double Products(const Problem& problem, int first, int row, int column, int channel) {
  const artifact::BackboneLayer& layer = problem.layer;
  double sum = 0.0;
  for (int i = first; i < layer.input.channels; ++i) {
    for (int y = 0; y < layer.kernel; ++y) {
      for (int x = 0; x < layer.kernel; ++x) {
        const int from_row = row * layer.stride - layer.kernel / 2 + y;
        const int from_column = column * layer.stride - layer.kernel / 2 + x;
        if (from_row < 0 || from_row >= layer.input.height || from_column < 0 ||
            from_column >= layer.input.width) {
          continue;
        }
        const size_t weight =
            ((static_cast<size_t>(channel) * layer.input.channels + i) * layer.kernel + y) *
                layer.kernel +
            x;
        const size_t place = (static_cast<size_t>(from_row) * layer.input.width + from_column) *
                                 layer.input.channels +
                             i;
        sum += double{problem.folded.weight[weight]} * problem.raster[place];
      }
    }
  }
  return sum;
}

}  // namespace maneuver::inference

#endif  // MANEUVER_TESTS_UNIT_MODEL_INFERENCE_CONVOLUTION_PROBLEM_H_
