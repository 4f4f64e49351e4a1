#include "model/inference/backbone_step.h"

#include <algorithm>

namespace maneuver::inference {
namespace {

using artifact::BackboneLayer;
using dnnl::memory;
using Format = dnnl::memory::format_tag;
using Kind = artifact::BackboneLayer::Kind;
using Type = dnnl::memory::data_type;

bool SuitsWinograd(const BackboneLayer& layer) {
  return layer.kind == Kind::kConvolution && layer.kernel == 3 && layer.stride == 1;
}

bool FillsBlocks(const BackboneLayer& layer) {
  return layer.input.channels % kBlockChannels == 0 && layer.output.channels % kBlockChannels == 0;
}

bool ProcessorHasAvx512() {
  constexpr unsigned kAvx512 = static_cast<unsigned>(dnnl::cpu_isa::avx512_core);
  return (static_cast<unsigned>(dnnl::get_effective_cpu_isa()) & kAvx512) == kAvx512;
}

}  // namespace

dnnl::engine& CpuEngine() {
  static dnnl::engine engine(dnnl::engine::kind::cpu, 0);
  return engine;
}

memory::desc GridDescription(const artifact::GridSize& grid, Type type, GridLayout layout) {
  // Asked for `any` layout here, oneDNN mixes layouts and falls back to its reference loops, a
  // hundred times slower.
  const Format format = layout == GridLayout::kChannelBlocks ? Format::nChw16c : Format::nhwc;
  return {{1, grid.channels, grid.height, grid.width}, type, format};
}

size_t FirstInBlocks(std::span<const BackboneLayer> layers, size_t begin, bool bf16) {
  if (bf16 || !ProcessorHasAvx512()) return layers.size();
  // An average leaves nothing that lies in blocks.
  if (layers.back().kind != Kind::kAveragePool) return layers.size();
  begin = std::max<size_t>(begin, 1);  // the raster's channels fill no block
  while (begin < layers.size() && layers[begin].kind == Kind::kMaxPool) ++begin;
  const auto rest = layers.subspan(std::min(begin, layers.size()));
  const bool pays =
      std::ranges::all_of(rest, FillsBlocks) && std::ranges::any_of(rest, SuitsWinograd);
  return pays ? begin : layers.size();
}

void MakeConvolution(const FoldedConvolution& folded, BackboneStep* step) {
  const BackboneLayer& layer = step->layer;
  const memory::dim kernel = layer.kernel;
  const memory::dims weight_dims = {layer.output.channels, layer.input.channels, kernel, kernel};
  const memory::desc any_weight(weight_dims, step->source.data_type(), Format::any);
  const memory::desc bias({layer.output.channels}, Type::f32, Format::x);
  dnnl::post_ops operations;
  if (layer.adds) operations.append_sum(1.0f);
  if (layer.relu) operations.append_eltwise(1.0f, dnnl::algorithm::eltwise_relu, 0.0f, 0.0f);
  dnnl::primitive_attr attributes;
  attributes.set_post_ops(operations);
  attributes.set_scratchpad_mode(dnnl::scratchpad_mode::user);  // else it is shared by threads

  const memory::dims strides = {layer.stride, layer.stride};
  const memory::dims padding = {kernel / 2, kernel / 2};
  const auto describe = [&](dnnl::algorithm algorithm, bool may_be_none) {
    return dnnl::convolution_forward::primitive_desc(
        {dnnl::prop_kind::forward_inference, algorithm, step->source, any_weight, bias,
         step->destination, strides, padding, padding},
        attributes, CpuEngine(), may_be_none);
  };
  dnnl::convolution_forward::primitive_desc description;
  if (step->layout == GridLayout::kChannelBlocks && SuitsWinograd(layer)) {
    description = describe(dnnl::algorithm::convolution_winograd, /*may_be_none=*/true);
  }
  if (!description) description = describe(dnnl::algorithm::convolution_direct, false);
  step->primitive = dnnl::convolution_forward(description);
  step->scratchpad = description.scratchpad_desc();

  dnnl::stream stream(CpuEngine());
  memory plain({weight_dims, Type::f32, Format::oihw}, CpuEngine(),
               const_cast<float*>(folded.weight.data()));  // only read
  step->weight = memory(description.weights_desc(), CpuEngine());
  dnnl::reorder(plain, step->weight).execute(stream, plain, step->weight);
  stream.wait();
  step->bias = memory(bias, CpuEngine());
  std::copy(folded.bias.begin(), folded.bias.end(),
            static_cast<float*>(step->bias.get_data_handle()));
}

void MakeMaxPool(BackboneStep* step) {
  const BackboneLayer& layer = step->layer;
  const memory::dims strides = {layer.stride, layer.stride};
  const memory::dims kernel = {layer.kernel, layer.kernel};
  const memory::dims padding = {layer.kernel / 2, layer.kernel / 2};
  dnnl::primitive_attr attributes;
  attributes.set_scratchpad_mode(dnnl::scratchpad_mode::user);
  const dnnl::pooling_forward::primitive_desc description(
      {dnnl::prop_kind::forward_inference, dnnl::algorithm::pooling_max, step->source,
       step->destination, strides, kernel, padding, padding},
      attributes, CpuEngine());
  step->primitive = dnnl::pooling_forward(description);
  step->scratchpad = description.scratchpad_desc();
}

}  // namespace maneuver::inference
