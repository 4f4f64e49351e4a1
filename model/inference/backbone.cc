#include "model/inference/backbone.h"

#include <omp.h>

#include <algorithm>
#include <dnnl.hpp>
#include <optional>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "model/artifact/backbone_layers.h"
#include "model/inference/backbone_step.h"
#include "model/inference/folded_convolution.h"
#include "model/inference/leading_layers.h"
#include "model/kernels/bf16.h"

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

float Widen(float value) { return value; }
float Widen(uint16_t bf16) { return kernels::FromBf16(bf16); }

// The mean of each channel.
//   grid: [h, w, C];  mean: [C]
template <typename Value>
void AverageCells(const Value* grid, size_t cells, size_t channels, float* mean) {
  std::fill_n(mean, channels, 0.0f);
  for (size_t cell = 0; cell < cells; ++cell) {
    for (size_t c = 0; c < channels; ++c) mean[c] += Widen(grid[cell * channels + c]);
  }
  for (size_t c = 0; c < channels; ++c) mean[c] /= static_cast<float>(cells);
}

// Averages the cells of an average pool's input.
//   grid: as step.source says;  mean: [C]
void AverageCells(const BackboneStep& step, const void* grid, float* mean) {
  const GridSize& size = step.layer.input;
  const size_t cells = static_cast<size_t>(size.height) * static_cast<size_t>(size.width);
  const size_t channels = static_cast<size_t>(size.channels);
  if (step.source.data_type() == Type::bf16) {
    AverageCells(static_cast<const uint16_t*>(grid), cells, channels, mean);
    return;
  }
  const auto* values = static_cast<const float*>(grid);
  // Each block is a grid of its channels.
  const size_t together = step.layout == GridLayout::kChannelBlocks ? kBlockChannels : channels;
  for (size_t c = 0; c < channels; c += together) {
    AverageCells(values + c * cells, cells, together, mean + c);
  }
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
  std::vector<BackboneStep> steps;
  size_t first_in_blocks = 0;  // of the steps; as many as there are if none is
  dnnl::reorder to_blocks;     // of that step's source
  // In place of the first steps, for a raster whose pixels are mostly zero.
  std::optional<LeadingLayers> leading;
  size_t leading_steps = 0;
};

class Backbone::Scratch {
 public:
  explicit Scratch(const Layers& layers)
      : stream(CpuEngine()), bytes(layers.bytes, CpuEngine(), nullptr) {
    // Each register is as large as the largest grid that comes to it.
    size_t sizes[kGridLayouts][artifact::kBackboneRegisters] = {{layers.values.get_size()}};
    size_t scratchpad_size = 0;
    for (const BackboneStep& step : layers.steps) {
      for (const auto& [number, held] : {std::pair(step.layer.source, step.source),
                                         std::pair(step.layer.destination, step.destination)}) {
        size_t& size = sizes[static_cast<size_t>(step.layout)][number];
        size = std::max(size, held.get_size());
      }
      scratchpad_size = std::max(scratchpad_size, step.scratchpad.get_size());
    }
    for (int layout = 0; layout < kGridLayouts; ++layout) {
      for (int r = 0; r < artifact::kBackboneRegisters; ++r) {
        registers[layout][r] = Allocate(sizes[layout][r]);
      }
    }
    scratchpad = Allocate(scratchpad_size);
    values = At(layers.values, registers[0][0]);
    for (const BackboneStep& step : layers.steps) {
      memory* const places = registers[static_cast<size_t>(step.layout)];
      memory destination = At(step.destination, places[step.layer.destination]);
      if (&step == &layers.steps.back()) {
        destination = memory(step.destination, CpuEngine(), nullptr);
        grid = destination;  // a handle: the same memory object
      }
      arguments.push_back({{DNNL_ARG_SRC, At(step.source, places[step.layer.source])},
                           {DNNL_ARG_DST, destination},
                           {DNNL_ARG_SCRATCHPAD, At(step.scratchpad, scratchpad)}});
      if (step.layer.kind != Kind::kConvolution) continue;
      arguments.back().insert({{DNNL_ARG_WEIGHTS, step.weight}, {DNNL_ARG_BIAS, step.bias}});
    }
    if (layers.first_in_blocks < layers.steps.size()) {
      const BackboneLayer& first = layers.steps[layers.first_in_blocks].layer;
      to_blocks_from =
          At(GridDescription(first.input, layers.values.data_type()), registers[0][first.source]);
    }
    if (layers.leading) leading.emplace(*layers.leading);
  }

  dnnl::stream stream;
  std::vector<uint8_t> interleaved;  // the raster, for oneDNN's first layer
  memory bytes;                      // points there
  memory values;                     // in register 0
  memory grid;                       // points to the caller's grid
  memory to_blocks_from;
  memory registers[kGridLayouts][artifact::kBackboneRegisters];
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
  layers->bytes = GridDescription(raster, Type::u8);
  layers->values = GridDescription(raster, type);
  layers->widen = dnnl::reorder(
      dnnl::reorder::primitive_desc(CpuEngine(), layers->bytes, CpuEngine(), layers->values));
  const std::vector<BackboneLayer> list = artifact::BackboneLayers(spec);
  layers->leading_steps = LeadingLayers::Count(list, bf16);
  layers->first_in_blocks = FirstInBlocks(list, layers->leading_steps, bf16);
  std::vector<FoldedConvolution> leading;
  for (size_t i = 0; i < list.size(); ++i) {
    BackboneStep& step = layers->steps.emplace_back();
    step.layer = list[i];
    if (i >= layers->first_in_blocks) step.layout = GridLayout::kChannelBlocks;
    step.source = GridDescription(list[i].input, type, step.layout);
    // The last is an average where grids lie in blocks: one cell, which has no layout.
    step.destination = i + 1 == list.size() ? GridDescription(list[i].output, Type::f32)
                                            : GridDescription(list[i].output, type, step.layout);
    if (step.layer.kind == Kind::kConvolution) {
      // The raster's bytes go in as they are: the first layer divides them.
      const auto folded = Fold(weights, step.layer, i == 0 ? 1.0 / kFullIntensity : 1.0);
      MakeConvolution(folded, &step);
      if (i < layers->leading_steps) leading.push_back(folded);
    } else if (step.layer.kind == Kind::kMaxPool) {
      MakeMaxPool(&step);
    }
  }
  if (layers->first_in_blocks < list.size()) {
    const BackboneStep& first = layers->steps[layers->first_in_blocks];
    layers->to_blocks = dnnl::reorder(dnnl::reorder::primitive_desc(
        CpuEngine(), GridDescription(first.layer.input, type), CpuEngine(), first.source));
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
  for (const BackboneStep& step : layers_->steps) {
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
    const BackboneStep& step = layers_->steps[i];
    if (i == layers_->first_in_blocks) {
      layers_->to_blocks.execute(scratch->stream, scratch->to_blocks_from,
                                 scratch->arguments[i].at(DNNL_ARG_SRC));
    }
    if (step.layer.kind == Kind::kAveragePool) {
      scratch->stream.wait();
      AverageCells(step, scratch->arguments[i].at(DNNL_ARG_SRC).get_data_handle(), grid);
    } else {
      step.primitive.execute(scratch->stream, scratch->arguments[i]);
    }
  }
  scratch->stream.wait();
}

}  // namespace maneuver::inference
