#include "model/learning/autograd/raster_convolution.h"

#include <torch/csrc/autograd/custom_function.h>

#include <optional>
#include <utility>
#include <vector>

#include "model/kernels/nonzero_convolution.h"
#include "model/learning/autograd/parallel.h"

namespace maneuver::learning {
namespace {

using kernels::ConvolutionShape;
using kernels::NonzeroValues;
using torch::autograd::AutogradContext;
using torch::autograd::Variable;
using torch::autograd::variable_list;

constexpr double kFullIntensity = 255.0;

// Where a larger share of the values is nonzero, oneDNN is faster, which multiplies all.
constexpr double kMostNonzero = 0.25;

// A batch's, for the way back.
struct NonzeroBatch : torch::CustomClassHolder {
  ConvolutionShape shape;
  std::vector<std::optional<NonzeroValues>> rasters;
};

c10::intrusive_ptr<NonzeroBatch> FindNonzero(const at::Tensor& rasters, const at::Tensor& weight,
                                             int64_t stride) {
  auto batch = c10::make_intrusive<NonzeroBatch>();
  batch->shape = {rasters.size(1), rasters.size(2), rasters.size(3),
                  weight.size(0),  weight.size(2),  stride};
  batch->rasters.resize(static_cast<size_t>(rasters.size(0)));
  const auto* const bytes = rasters.data_ptr<uint8_t>();
  const int64_t raster_bytes = rasters.stride(0);
  at::parallel_for(0, rasters.size(0), 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      batch->rasters[static_cast<size_t>(i)].emplace(batch->shape, bytes + i * raster_bytes);
    }
  });
  return batch;
}

// [C', C, k, k] as [k, k, C, C'], the last rounded up to whole vectors.
at::Tensor Packed(const ConvolutionShape& shape, const at::Tensor& weight) {
  const int64_t outputs = NonzeroValues::VectorMultiple(shape.outputs);
  at::Tensor packed =
      at::zeros({shape.kernel, shape.kernel, shape.channels, outputs}, weight.options());
  packed.narrow(3, 0, shape.outputs).copy_(weight.permute({2, 3, 1, 0}));
  return packed;
}

class NonzeroConvolution : public torch::autograd::Function<NonzeroConvolution> {
 public:
  static Variable forward(AutogradContext* context, const Variable& weight,
                          const c10::intrusive_ptr<NonzeroBatch>& batch) {
    const ConvolutionShape& shape = batch->shape;
    const at::Tensor packed = Packed(shape, weight.detach()).div_(kFullIntensity);
    const auto count = static_cast<int64_t>(batch->rasters.size());
    const at::Tensor output = at::empty(
        {count, shape.output_height(), shape.output_width(), shape.outputs}, weight.options());
    at::parallel_for(0, count, 1, [&](int64_t begin, int64_t end) {
      for (int64_t i = begin; i < end; ++i) {
        batch->rasters[static_cast<size_t>(i)]->Convolve(
            shape, packed.data_ptr<float>(), output.data_ptr<float>() + i * output.stride(0));
      }
    });
    context->saved_data["batch"] = c10::IValue::make_capsule(batch);
    return output.permute({0, 3, 1, 2});
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    TORCH_CHECK(!at::GradMode::is_enabled(), "the convolution has no second derivative here");
    const auto batch =
        c10::static_intrusive_pointer_cast<NonzeroBatch>(context->saved_data["batch"].toCapsule());
    const ConvolutionShape& shape = batch->shape;
    const at::Tensor gradient = gradients[0].permute({0, 2, 3, 1}).contiguous();
    // Each thread has its own sum, over examples that are the same in each run.
    std::vector<at::Tensor> sums(static_cast<size_t>(at::get_num_threads()));
    const int64_t outputs = NonzeroValues::VectorMultiple(shape.outputs);
    for (at::Tensor& sum : sums) {
      sum = at::zeros({shape.kernel, shape.kernel, shape.channels, outputs}, gradient.options());
    }
    at::parallel_for(0, gradient.size(0), 1, [&](int64_t begin, int64_t end) {
      auto* const sum = sums[static_cast<size_t>(at::get_thread_num())].data_ptr<float>();
      for (int64_t i = begin; i < end; ++i) {
        batch->rasters[static_cast<size_t>(i)]->AddWeightGradient(
            shape, gradient.data_ptr<float>() + i * gradient.stride(0), sum);
      }
    });
    for (size_t i = 1; i < sums.size(); ++i) sums[0] += sums[i];
    return {sums[0].narrow(3, 0, shape.outputs).permute({3, 2, 0, 1}).div_(kFullIntensity),
            Variable()};
  }
};

}  // namespace

at::Tensor ConvolveRasters(const at::Tensor& rasters, const at::Tensor& weight, int64_t stride) {
  if (weight.is_cpu() && rasters.is_cpu()) {
    const auto batch = FindNonzero(rasters.contiguous(), weight, stride);
    size_t nonzero = 0;
    for (const std::optional<NonzeroValues>& raster : batch->rasters) {
      nonzero += raster->size();
    }
    if (static_cast<double>(nonzero) <= kMostNonzero * static_cast<double>(rasters.numel())) {
      return NonzeroConvolution::apply(weight, batch);
    }
  }
  // [B, H, W, C] seen as [B, C, H, W] is channels-last, which convolutions want.
  const at::Tensor numbers =
      rasters.to(weight.device()).permute({0, 3, 1, 2}).to(at::kFloat).mul_(1.0 / kFullIntensity);
  return at::conv2d(numbers, weight, {}, stride, weight.size(2) / 2);
}

}  // namespace maneuver::learning
