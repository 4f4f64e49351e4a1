// The backbone as a list of layers. Learning, inference and the shapes of weights follow it.

#ifndef MANEUVER_MODEL_ARTIFACT_BACKBONE_LAYERS_H_
#define MANEUVER_MODEL_ARTIFACT_BACKBONE_LAYERS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"

namespace maneuver::artifact {

struct GridSize {
  int channels = 0;
  int height = 0;
  int width = 0;

  int64_t values() const { return int64_t{channels} * height * width; }
};

// Returns the grid of the raster as the backbone reads it.
GridSize RasterGrid(const v1::RasterSpec& spec);

// Grids are kept in a few registers. A layer reads one register and writes another, whose old
// content is lost. At first, register 0 holds the raster.
struct BackboneLayer {
  enum class Kind {
    kConvolution,  // with batch normalisation
    kMaxPool,      // maximum over the kernel's cells that lie in the grid
    kAveragePool,  // mean over the whole grid, which leaves one cell
  };
  Kind kind = Kind::kConvolution;
  // Prefixes of a convolution's tensors, before ".weight" etc. (tensor.h).
  std::string convolution;
  std::string normalization;
  // Square kernel, padded by half of it on each side; 0 for the average.
  int kernel = 0;
  int stride = 1;
  // Adds what the destination already holds to the layer's output: the end of a residual block.
  bool adds = false;
  // ReLU follows, after the addition.
  bool relu = false;
  int source = 0;
  int destination = 0;
  GridSize input;
  GridSize output;
};

// The number of registers that the layers use.
inline constexpr int kBackboneRegisters = 3;

// Returns the layers in the order of evaluation. The last one's output is flattened for the
// projection. Each field of the spec must be valid by itself.
std::vector<BackboneLayer> BackboneLayers(const v1::ModelSpec& spec);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_BACKBONE_LAYERS_H_
