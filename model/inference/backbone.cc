#include "model/inference/backbone.h"

#include <omp.h>

#include <algorithm>
#include <cmath>
#include <dnnl.hpp>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_spec.h"

namespace maneuver::inference {
namespace {

using artifact::GridSize;
using dnnl::memory;
using Format = dnnl::memory::format_tag;
using Type = dnnl::memory::data_type;

constexpr double kNormalizationEpsilon = 1e-5;  // tensor.h
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

memory::dims GridDims(const GridSize& grid) { return {1, grid.channels, grid.height, grid.width}; }

// A convolution's weights and bias with its batch normalisation in them:
// gamma (w x - m) / sqrt(v + eps) + beta.
struct FoldedWeights {
  std::vector<float> weight;  // [C_out, C_in, 3, 3]
  std::vector<float> bias;    // [C_out]
};

FoldedWeights Fold(const artifact::TensorMap& weights, int layer) {
  const auto part = [&](const char* name) -> const std::vector<float>& {
    return weights.at(absl::StrCat("backbone.normalization.", layer, ".", name)).values;
  };
  FoldedWeights folded;
  folded.weight = weights.at(absl::StrCat("backbone.convolution.", layer, ".weight")).values;
  const size_t outputs = part("weight").size();
  const size_t taps = folded.weight.size() / outputs;
  // The raster's bytes go in as they are: the first layer divides them.
  const double input_scale = layer == 0 ? 1.0 / kFullIntensity : 1.0;
  for (size_t c = 0; c < outputs; ++c) {
    const double scale =
        part("weight")[c] / std::sqrt(double{part("running_var")[c]} + kNormalizationEpsilon);
    for (size_t i = 0; i < taps; ++i) {
      float& weight = folded.weight[c * taps + i];
      weight = static_cast<float>(weight * scale * input_scale);
    }
    folded.bias.push_back(
        static_cast<float>(part("bias")[c] - double{part("running_mean")[c]} * scale));
  }
  return folded;
}

struct Convolution {
  dnnl::convolution_forward::primitive_desc description;
  dnnl::convolution_forward primitive;
  memory weight;  // packed as the primitive wants it
  memory bias;
};

Convolution MakeConvolution(const memory::desc& source, const GridSize& input,
                            const GridSize& output, int stride, bool last, FoldedWeights folded,
                            Type type) {
  const memory::dims weight_dims = {output.channels, input.channels, 3, 3};
  const memory::desc any_weight(weight_dims, type, Format::any);
  const memory::desc bias({output.channels}, Type::f32, Format::x);
  // [h, w, C] on both sides is what oneDNN's vector kernels take for any number of channels. Asked
  // for `any` layout here it mixes layouts and falls back to its reference loops, a hundred times
  // slower.
  const memory::desc destination(GridDims(output), last ? Type::f32 : type, Format::nhwc);
  dnnl::post_ops relu;
  relu.append_eltwise(1.0f, dnnl::algorithm::eltwise_relu, 0.0f, 0.0f);
  dnnl::primitive_attr attributes;
  attributes.set_post_ops(relu);
  attributes.set_scratchpad_mode(dnnl::scratchpad_mode::user);  // else it is shared by threads

  const dnnl::convolution_forward::desc operation(
      dnnl::prop_kind::forward_inference, dnnl::algorithm::convolution_direct, source, any_weight,
      bias, destination, {stride, stride}, {1, 1}, {1, 1});
  Convolution convolution;
  convolution.description =
      dnnl::convolution_forward::primitive_desc(operation, attributes, CpuEngine());
  convolution.primitive = dnnl::convolution_forward(convolution.description);

  dnnl::stream stream(CpuEngine());
  memory plain({weight_dims, Type::f32, Format::oihw}, CpuEngine(), folded.weight.data());
  convolution.weight = memory(convolution.description.weights_desc(), CpuEngine());
  dnnl::reorder(plain, convolution.weight).execute(stream, plain, convolution.weight);
  stream.wait();
  convolution.bias = memory(bias, CpuEngine());
  std::copy(folded.bias.begin(), folded.bias.end(),
            static_cast<float*>(convolution.bias.get_data_handle()));
  return convolution;
}

}  // namespace

bool ProcessorHasBf16() {
  // The enumerators are sets of features, one bit each.
  constexpr unsigned kBf16 = static_cast<unsigned>(dnnl::cpu_isa::avx512_core_bf16);
  return (static_cast<unsigned>(dnnl::get_effective_cpu_isa()) & kBf16) == kBf16;
}

struct Backbone::Layers {
  memory::desc bytes;   // the raster as it comes
  memory::desc values;  // the raster as the first convolution reads it
  dnnl::reorder widen;  // bytes to values; exact, also in bf16
  std::vector<Convolution> convolutions;
};

class Backbone::Scratch {
 public:
  explicit Scratch(const Layers& layers)
      : stream(CpuEngine()),
        bytes(layers.bytes, CpuEngine(), nullptr),
        values(layers.values, CpuEngine()) {
    memory source = values;  // handles: copies refer to the same memory
    for (size_t i = 0; i < layers.convolutions.size(); ++i) {
      const Convolution& convolution = layers.convolutions[i];
      const bool last = i + 1 == layers.convolutions.size();
      const memory::desc destination = convolution.description.dst_desc();
      outputs.push_back(last ? memory(destination, CpuEngine(), nullptr)
                             : memory(destination, CpuEngine()));
      steps.push_back(
          {{DNNL_ARG_SRC, source},
           {DNNL_ARG_WEIGHTS, convolution.weight},
           {DNNL_ARG_BIAS, convolution.bias},
           {DNNL_ARG_SCRATCHPAD, memory(convolution.description.scratchpad_desc(), CpuEngine())},
           {DNNL_ARG_DST, outputs.back()}});
      source = outputs.back();
    }
  }

  dnnl::stream stream;
  memory bytes;  // points to the caller's raster
  memory values;
  std::vector<memory> outputs;  // the last points to the caller's grid
  std::vector<std::unordered_map<int, memory>> steps;
};

void Backbone::ScratchDeleter::operator()(Scratch* scratch) const { delete scratch; }

Backbone::Backbone(const v1::ModelSpec& spec, const artifact::TensorMap& weights, bool bf16) {
  const OneThread one_thread;
  const Type type = bf16 ? Type::bf16 : Type::f32;
  auto layers = std::make_unique<Layers>();
  const GridSize raster = artifact::BackboneGrid(spec, 0);
  layers->bytes = memory::desc(GridDims(raster), Type::u8, Format::nhwc);
  layers->values = memory::desc(GridDims(raster), type, Format::nhwc);
  layers->widen = dnnl::reorder(
      dnnl::reorder::primitive_desc(CpuEngine(), layers->bytes, CpuEngine(), layers->values));
  const int count = spec.backbone().convolutions_size();
  for (int i = 0; i < count; ++i) {
    const memory::desc source =
        i == 0 ? layers->values : layers->convolutions.back().description.dst_desc();
    layers->convolutions.push_back(MakeConvolution(
        source, artifact::BackboneGrid(spec, i), artifact::BackboneGrid(spec, i + 1),
        spec.backbone().convolutions(i).stride(), i + 1 == count, Fold(weights, i), type));
  }
  layers_ = std::move(layers);
}

Backbone::~Backbone() = default;

size_t Backbone::bytes() const {
  size_t bytes = 0;
  for (const Convolution& convolution : layers_->convolutions) {
    bytes += convolution.weight.get_desc().get_size() + convolution.bias.get_desc().get_size();
  }
  return bytes;
}

Backbone::ScratchPointer Backbone::NewScratch() const {
  const OneThread one_thread;
  return ScratchPointer(new Scratch(*layers_));
}

void Backbone::Evaluate(const uint8_t* raster, Scratch* scratch, float* grid) const {
  const OneThread one_thread;
  scratch->bytes.set_data_handle(const_cast<uint8_t*>(raster));  // only read
  scratch->outputs.back().set_data_handle(grid);
  layers_->widen.execute(scratch->stream, scratch->bytes, scratch->values);
  for (size_t i = 0; i < layers_->convolutions.size(); ++i) {
    layers_->convolutions[i].primitive.execute(scratch->stream, scratch->steps[i]);
  }
  scratch->stream.wait();
}

}  // namespace maneuver::inference
