// A layer of the backbone as oneDNN computes it.

#ifndef MANEUVER_MODEL_INFERENCE_BACKBONE_STEP_H_
#define MANEUVER_MODEL_INFERENCE_BACKBONE_STEP_H_

#include <cstddef>
#include <dnnl.hpp>
#include <span>

#include "model/artifact/backbone_layers.h"
#include "model/inference/folded_convolution.h"

namespace maneuver::inference {

dnnl::engine& CpuEngine();

// How a grid of c channels lies in memory.
enum class GridLayout {
  kChannelsLast,   // [h, w, c]: taken by oneDNN's vector kernels for any number of channels
  kChannelBlocks,  // [c / 16, h, w, 16]: what its Winograd convolutions ask for
};
inline constexpr int kGridLayouts = 2;
// Channels of a block.
inline constexpr int kBlockChannels = 16;

// A layer made ready. An average has no primitive: oneDNN's cannot widen bf16.
struct BackboneStep {
  artifact::BackboneLayer layer;
  GridLayout layout = GridLayout::kChannelsLast;
  dnnl::memory::desc source;
  dnnl::memory::desc destination;
  dnnl::primitive primitive;
  dnnl::memory::desc scratchpad;
  dnnl::memory weight;  // packed as the primitive wants it
  dnnl::memory bias;
};

dnnl::memory::desc GridDescription(const artifact::GridSize& grid, dnnl::memory::data_type type,
                                   GridLayout layout = GridLayout::kChannelsLast);

// The first of the layers, from `begin` on, whose grids should lie in blocks, as should those of
// all after it: a residual network in f32 computes its 3x3 convolutions by Winograd's minimal
// filtering (Lavin and Gray, Fast Algorithms for Convolutional Neural Networks, 2016), with a
// quarter to a half of the multiplications and errors some times those of f32. layers.size() if
// none should.
size_t FirstInBlocks(std::span<const artifact::BackboneLayer> layers, size_t begin, bool bf16);

// Fill in all but the layer, the layout and the descriptions of source and destination, which are
// read.
void MakeConvolution(const FoldedConvolution& folded, BackboneStep* step);
void MakeMaxPool(BackboneStep* step);

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_BACKBONE_STEP_H_
