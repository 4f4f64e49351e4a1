#include "model/artifact/backbone_layers.h"

#include <utility>

#include "absl/strings/str_cat.h"

namespace maneuver::artifact {
namespace {

using Kind = BackboneLayer::Kind;

constexpr int kMapChannels = 3;
constexpr int kExpansion = 4;  // of a bottleneck's width, He et al., table 1

// Returns the size after padding by half the kernel: the number of multiples of the stride.
int StridedSize(int size, int stride) { return (size - 1) / stride + 1; }

// Adds layers one after another.
class Builder {
 public:
  explicit Builder(const GridSize& raster) : grids_{raster, {}, {}} {}

  BackboneLayer& Add(Kind kind, int kernel, int stride, int channels, int source, int destination) {
    BackboneLayer& layer = layers_.emplace_back();
    layer.kind = kind;
    layer.kernel = kernel;
    layer.stride = stride;
    layer.source = source;
    layer.destination = destination;
    layer.input = grids_[source];
    layer.output = {channels, StridedSize(layer.input.height, stride),
                    StridedSize(layer.input.width, stride)};
    grids_[destination] = layer.output;
    return layer;
  }

  // In names, `prefix` and `suffix` surround "convolution" and "normalization".
  BackboneLayer& AddConvolution(const std::string& prefix, const std::string& suffix, int kernel,
                                int stride, int channels, int source, int destination) {
    BackboneLayer& layer = Add(Kind::kConvolution, kernel, stride, channels, source, destination);
    layer.convolution = absl::StrCat(prefix, "convolution", suffix);
    layer.normalization = absl::StrCat(prefix, "normalization", suffix);
    layer.relu = true;
    return layer;
  }

  // Averages over the whole grid.
  void AddAveragePool(int source, int destination) {
    BackboneLayer& layer =
        Add(Kind::kAveragePool, 0, 1, grids_[source].channels, source, destination);
    layer.output.height = 1;
    layer.output.width = 1;
  }

  int channels(int grid) const { return grids_[grid].channels; }
  std::vector<BackboneLayer> layers() && { return std::move(layers_); }

 private:
  GridSize grids_[kBackboneRegisters];  // what is in each register now
  std::vector<BackboneLayer> layers_;
};

// Adds a block whose input is in register `input`. Returns the register of its output. Three
// registers suffice: the last convolution's destination already holds what it adds to.
int AddBlock(const std::string& name, v1::ResidualBlock kind, int width, int stride, int input,
             Builder* builder) {
  const int first = (input + 1) % kBackboneRegisters;
  const int second = (input + 2) % kBackboneRegisters;
  const bool bottleneck = kind == v1::RESIDUAL_BLOCK_BOTTLENECK;
  const int outputs = bottleneck ? kExpansion * width : width;
  const int inputs = builder->channels(input);
  int last_source = first;
  if (bottleneck) {
    builder->AddConvolution(name, ".0", 1, 1, width, input, first);
    builder->AddConvolution(name, ".1", 3, stride, width, first, second);
    last_source = second;
  } else {
    builder->AddConvolution(name, ".0", 3, stride, width, input, first);
  }
  int output = input;
  if (stride != 1 || inputs != outputs) {
    output = last_source == first ? second : first;
    builder->AddConvolution(absl::StrCat(name, "shortcut."), "", 1, stride, outputs, input, output)
        .relu = false;
  }
  builder
      ->AddConvolution(name, bottleneck ? ".2" : ".1", bottleneck ? 1 : 3, 1, outputs, last_source,
                       output)
      .adds = true;
  return output;
}

void AddResidual(const v1::ResidualSpec& residual, Builder* builder) {
  const v1::StemSpec& stem = residual.stem();
  builder->AddConvolution("backbone.stem.", "", stem.kernel_size(), stem.stride(), stem.channels(),
                          0, 1);
  int grid = 1;
  if (stem.max_pool()) {
    builder->Add(Kind::kMaxPool, 3, 2, stem.channels(), 1, 0);
    grid = 0;
  }
  for (int s = 0; s < residual.stages_size(); ++s) {
    const v1::ResidualStageSpec& stage = residual.stages(s);
    for (int b = 0; b < stage.blocks(); ++b) {
      grid = AddBlock(absl::StrCat("backbone.stage.", s, ".block.", b, "."), residual.block(),
                      stage.width(), b == 0 ? stage.stride() : 1, grid, builder);
    }
  }
  builder->AddAveragePool(grid, (grid + 1) % kBackboneRegisters);
}

}  // namespace

GridSize RasterGrid(const v1::RasterSpec& spec) {
  return {kMapChannels + 2 * spec.history_frames(), spec.height(), spec.width()};
}

std::vector<BackboneLayer> BackboneLayers(const v1::ModelSpec& spec) {
  Builder builder(RasterGrid(spec.raster()));
  const v1::BackboneSpec& backbone = spec.backbone();
  if (backbone.has_residual()) {
    AddResidual(backbone.residual(), &builder);
  } else {
    for (int i = 0; i < backbone.convolutions_size(); ++i) {
      const v1::ConvolutionSpec& convolution = backbone.convolutions(i);
      builder.AddConvolution("backbone.", absl::StrCat(".", i), 3, convolution.stride(),
                             convolution.channels(), i % 2, (i + 1) % 2);
    }
  }
  return std::move(builder).layers();
}

}  // namespace maneuver::artifact
