// The backbone as a list of layers, which learning, inference and the shapes of weights follow.

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

// The raster as the backbone reads it.
GridSize RasterGrid(const v1::RasterSpec& spec);

// Grids are held in a few registers: a layer reads one and writes another, whose former content is
// then gone. The raster is in register 0 at first.
struct BackboneLayer {
  enum class Kind {
    kConvolution,  // with batch normalisation
    kMaxPool,      // maximum over the kernel's cells that lie in the grid
    kAveragePool,  // mean over the whole grid, which leaves one cell
  };
  Kind kind = Kind::kConvolution;
  // Of a convolution, what its tensors are called before ".weight" etc. (tensor.h).
  std::string convolution;
  std::string normalization;
  // Square kernel, padded by half of it on each side; 0 for the average.
  int kernel = 0;
  int stride = 1;
  // What is in the destination already is added to the layer's output: the end of a residual block.
  bool adds = false;
  // ReLU follows, after the addition.
  bool relu = false;
  int source = 0;
  int destination = 0;
  GridSize input;
  GridSize output;
};

// Registers that layers use.
inline constexpr int kBackboneRegisters = 3;

// In the order of evaluation; the last one's output is flattened for the projection. Of a spec
// whose single fields are good.
std::vector<BackboneLayer> BackboneLayers(const v1::ModelSpec& spec);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_BACKBONE_LAYERS_H_
