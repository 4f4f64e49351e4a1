#include "model/inference/backbone.h"

#include <omp.h>

#include <algorithm>
#include <bit>
#include <dnnl.hpp>
#include <optional>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "model/artifact/backbone_layers.h"
#include "model/inference/folded_convolution.h"
#include "model/inference/leading_layers.h"

namespace maneuver::inference {
namespace {

using artifact::BackboneLayer;
using artifact::GridSize;
using Kind = artifact::BackboneLayer::Kind;
using dnnl::memory;
using Format = dnnl::memory::format_tag;
using Type = dnnl::memory::data_type;

constexpr float kFullIntensity = 255.0f;

// Keeps oneDNN to the calling thread while it lives. The setting is that thread's own and is put
// back: the trainer runs LibTorch on the same OpenMP.
class OneThread {
 public:
  OneThread() : before_(omp_get_max_threads()) { omp_set_num_threads(1); }
  ~OneThread() { omp_set_num_threads(before_); }
  OneThread(const OneThread&) = delete;
  OneThread& operator=(const OneThread&) = delete;

 private:
  int before_;
};

dnnl::engine& CpuEngine() {
  static dnnl::engine engine(dnnl::engine::kind::cpu, 0);
  return engine;
}

memory::desc Description(const GridSize& grid, Type type) {
  // [h, w, C] on both sides is what oneDNN's vector kernels take for any number of channels. Asked
  // for `any` layout here it mixes layouts and falls back to its reference loops, a hundred times
  // slower.
  return {{1, grid.channels, grid.height, grid.width}, type, Format::nhwc};
}

// A layer made ready. An average has no primitive: AverageCells is simpler than oneDNN's, which
// cannot widen bf16.
struct Step {
  BackboneLayer layer;
  memory::desc source;
  memory::desc destination;
  dnnl::primitive primitive;
  memory::desc scratchpad;
  memory weight;  // packed as the primitive wants it
  memory bias;
};

void MakeConvolution(const FoldedConvolution& folded, Step* step) {
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
  const dnnl::convolution_forward::primitive_desc description(
      {dnnl::prop_kind::forward_inference, dnnl::algorithm::convolution_direct, step->source,
       any_weight, bias, step->destination, strides, padding, padding},
      attributes, CpuEngine());
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

void MakeMaxPool(Step* step) {
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

float Widen(float value) { return value; }
float Widen(uint16_t bf16) { return std::bit_cast<float>(uint32_t{bf16} << 16); }

// The mean of each channel.
//   grid: [h, w, C];  mean: [C]
template <typename Value>
void AverageCells(const Value* grid, const GridSize& size, float* mean) {
  const size_t channels = static_cast<size_t>(size.channels);
  const size_t cells = static_cast<size_t>(size.height) * static_cast<size_t>(size.width);
  std::fill_n(mean, channels, 0.0f);
  for (size_t cell = 0; cell < cells; ++cell) {
    for (size_t c = 0; c < channels; ++c) mean[c] += Widen(grid[cell * channels + c]);
  }
  for (size_t c = 0; c < channels; ++c) mean[c] /= static_cast<float>(cells);
}

}  // namespace

bool ProcessorHasBf16() {
  // The enumerators are sets of features, one bit each.
  constexpr unsigned kBf16 = static_cast<unsigned>(dnnl::cpu_isa::avx512_core_bf16);
  return (static_cast<unsigned>(dnnl::get_effective_cpu_isa()) & kBf16) == kBf16;
}

struct Backbone::Layers {
  memory::desc bytes;   // the raster as it comes
  memory::desc values;  // the raster as the first layer reads it
  dnnl::reorder widen;  // bytes to values; exact, also in bf16
  std::vector<Step> steps;
  // In place of the first steps, for a raster that is black for the most part.
  std::optional<LeadingLayers> leading;
  size_t leading_steps = 0;
};

class Backbone::Scratch {
 public:
  explicit Scratch(const Layers& layers)
      : stream(CpuEngine()), bytes(layers.bytes, CpuEngine(), nullptr) {
    // Each register is as large as the largest grid that comes to it.
    size_t sizes[artifact::kBackboneRegisters] = {layers.values.get_size()};
    size_t scratchpad_size = 0;
    for (const Step& step : layers.steps) {
      size_t& size = sizes[step.layer.destination];
      size = std::max(size, step.destination.get_size());
      scratchpad_size = std::max(scratchpad_size, step.scratchpad.get_size());
    }
    for (int r = 0; r < artifact::kBackboneRegisters; ++r) registers[r] = Allocate(sizes[r]);
    scratchpad = Allocate(scratchpad_size);
    values = At(layers.values, registers[0]);
    for (const Step& step : layers.steps) {
      memory destination = At(step.destination, registers[step.layer.destination]);
      if (&step == &layers.steps.back()) {
        destination = memory(step.destination, CpuEngine(), nullptr);
        grid = destination;  // a handle: the same memory object
      }
      arguments.push_back({{DNNL_ARG_SRC, At(step.source, registers[step.layer.source])},
                           {DNNL_ARG_DST, destination},
                           {DNNL_ARG_SCRATCHPAD, At(step.scratchpad, scratchpad)}});
      if (step.layer.kind != Kind::kConvolution) continue;
      arguments.back().insert({{DNNL_ARG_WEIGHTS, step.weight}, {DNNL_ARG_BIAS, step.bias}});
    }
    if (layers.leading) leading.emplace(*layers.leading);
  }

  dnnl::stream stream;
  std::vector<uint8_t> interleaved;  // the raster, for oneDNN's first layer
  memory bytes;                      // points there
  memory values;                     // in register 0
  memory grid;                       // points to the caller's grid
  memory registers[artifact::kBackboneRegisters];
  memory scratchpad;                                       // one for all steps
  std::vector<std::unordered_map<int, memory>> arguments;  // of each step
  std::optional<LeadingLayers::Scratch> leading;

 private:
  static memory Allocate(size_t size) {
    return {{{static_cast<memory::dim>(std::max<size_t>(size, 1))}, Type::u8, Format::x},
            CpuEngine()};
  }
  static memory At(const memory::desc& description, const memory& place) {
    return {description, CpuEngine(), place.get_data_handle()};
  }
};

void Backbone::ScratchDeleter::operator()(Scratch* scratch) const { delete scratch; }

Backbone::Backbone(const v1::ModelSpec& spec, const artifact::TensorMap& weights, bool bf16) {
  const OneThread one_thread;
  const Type type = bf16 ? Type::bf16 : Type::f32;
  auto layers = std::make_unique<Layers>();
  const GridSize raster = artifact::RasterGrid(spec.raster());
  layers->bytes = Description(raster, Type::u8);
  layers->values = Description(raster, type);
  layers->widen = dnnl::reorder(
      dnnl::reorder::primitive_desc(CpuEngine(), layers->bytes, CpuEngine(), layers->values));
  const std::vector<BackboneLayer> list = artifact::BackboneLayers(spec);
  layers->leading_steps = LeadingLayers::Count(list, bf16);
  std::vector<FoldedConvolution> leading;
  for (size_t i = 0; i < list.size(); ++i) {
    Step& step = layers->steps.emplace_back();
    step.layer = list[i];
    step.source = Description(list[i].input, type);
    step.destination = Description(list[i].output, i + 1 == list.size() ? Type::f32 : type);
    if (step.layer.kind == Kind::kConvolution) {
      // The raster's bytes go in as they are: the first layer divides them.
      const auto folded = Fold(weights, step.layer, i == 0 ? 1.0 / kFullIntensity : 1.0);
      MakeConvolution(folded, &step);
      if (i < layers->leading_steps) leading.push_back(folded);
    } else if (step.layer.kind == Kind::kMaxPool) {
      MakeMaxPool(&step);
    }
  }
  if (layers->leading_steps > 0) {
    layers->leading.emplace(std::span(list).first(layers->leading_steps), leading, bf16,
                            bf16 && layers->leading_steps < list.size());
  }
  layers_ = std::move(layers);
}

Backbone::~Backbone() = default;

size_t Backbone::bytes() const {
  size_t bytes = 0;
  if (layers_->leading) bytes += layers_->leading->bytes();
  for (const Step& step : layers_->steps) {
    if (step.layer.kind != Kind::kConvolution) continue;
    bytes += step.weight.get_desc().get_size() + step.bias.get_desc().get_size();
  }
  return bytes;
}

Backbone::ScratchPointer Backbone::NewScratch() const {
  const OneThread one_thread;
  return ScratchPointer(new Scratch(*layers_));
}

void Backbone::Evaluate(const scene::Raster& raster, Scratch* scratch, float* grid) const {
  const OneThread one_thread;
  scratch->grid.set_data_handle(grid);
  size_t done = 0;
  if (layers_->leading) {
    const memory& last = scratch->arguments[layers_->leading_steps - 1].at(DNNL_ARG_DST);
    if (layers_->leading->Evaluate(raster, &*scratch->leading, last.get_data_handle())) {
      done = layers_->leading_steps;
    }
  }
  if (done == 0) {
    scratch->interleaved.resize(raster.values());
    raster.WriteInterleaved(scratch->interleaved);
    scratch->bytes.set_data_handle(scratch->interleaved.data());
    layers_->widen.execute(scratch->stream, scratch->bytes, scratch->values);
  }
  for (size_t i = done; i < layers_->steps.size(); ++i) {
    const Step& step = layers_->steps[i];
    if (step.layer.kind != Kind::kAveragePool) {
      step.primitive.execute(scratch->stream, scratch->arguments[i]);
      continue;
    }
    scratch->stream.wait();
    const void* source = scratch->registers[step.layer.source].get_data_handle();
    if (step.source.data_type() == Type::bf16) {
      AverageCells(static_cast<const uint16_t*>(source), step.layer.input, grid);
    } else {
      AverageCells(static_cast<const float*>(source), step.layer.input, grid);
    }
  }
  scratch->stream.wait();
}

}  // namespace maneuver::inference
