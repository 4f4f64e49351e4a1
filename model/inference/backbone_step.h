// Prepares the layers of the backbone for oneDNN.

#ifndef MANEUVER_MODEL_INFERENCE_BACKBONE_STEP_H_
#define MANEUVER_MODEL_INFERENCE_BACKBONE_STEP_H_

#include <cstddef>
#include <dnnl.hpp>
#include <span>

#include "model/artifact/backbone_layers.h"
#include "model/inference/folded_convolution.h"

namespace maneuver::inference {

// Returns the process's engine of oneDNN.
dnnl::engine& CpuEngine();

// The memory layout of a grid of c channels.
enum class GridLayout {
  kChannelsLast,   // [h, w, c]: oneDNN's vector kernels accept it for any number of channels
  kChannelBlocks,  // [c / 16, h, w, 16]: required by its Winograd convolutions
};
inline constexpr int kGridLayouts = 2;
// Channels of a block.
inline constexpr int kBlockChannels = 16;

// A prepared layer. An average has no primitive, because oneDNN's cannot widen bf16.
struct BackboneStep {
  artifact::BackboneLayer layer;
  GridLayout layout = GridLayout::kChannelsLast;
  dnnl::memory::desc source;
  dnnl::memory::desc destination;
  dnnl::primitive primitive;
  dnnl::memory::desc scratchpad;
  dnnl::memory weight;  // packed for the primitive
  dnnl::memory bias;
};

dnnl::memory::desc GridDescription(const artifact::GridSize& grid, dnnl::memory::data_type type,
                                   GridLayout layout = GridLayout::kChannelsLast);

// Returns the index of a layer, `begin` or more. The grids of that layer and all after it should
// use kChannelBlocks. Returns layers.size() if no grid should. A residual network in f32 uses them
// on a processor with AVX-512: it computes its 3x3 convolutions by Winograd's minimal filtering
// (Lavin and Gray, Fast Algorithms for Convolutional Neural Networks, 2016). That takes a quarter
// to a half of the multiplications, and its rounding errors are a few times those of a direct f32
// convolution.
size_t FirstInBlocks(std::span<const artifact::BackboneLayer> layers, size_t begin, bool bf16);

// Fill in all fields of `step` except the layer, the layout, and the descriptions of source and
// destination, which they read.
void MakeConvolution(const FoldedConvolution& folded, BackboneStep* step);
void MakeMaxPool(BackboneStep* step);

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_BACKBONE_STEP_H_
