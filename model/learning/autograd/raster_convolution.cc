#include "model/learning/autograd/raster_convolution.h"

#include <torch/csrc/autograd/custom_function.h>

#include <utility>
#include <vector>

#include "model/kernels/nonzero_convolution.h"
#include "model/learning/parallel.h"

namespace maneuver::learning {
namespace {

using kernels::ConvolutionShape;
using torch::autograd::AutogradContext;
using torch::autograd::Variable;
using torch::autograd::variable_list;

constexpr double kFullIntensity = 255.0;

// Where a larger share of the values is nonzero, oneDNN is faster, which multiplies all.
constexpr double kMostNonzero = 0.25;

// A batch's, for the way back.
struct NonzeroBatch : torch::CustomClassHolder {
  ConvolutionShape shape;
  RasterBatch rasters;
};

// [C', C, k, k] as [k, k, C, C'], the last rounded up to whole vectors.
at::Tensor Packed(const ConvolutionShape& shape, const at::Tensor& weight) {
  const int64_t outputs = kernels::PaddedOutputs(shape.outputs);
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
    const int64_t count = batch->rasters.size();
    const at::Tensor output = at::empty(
        {count, shape.output_height(), shape.output_width(), shape.outputs}, weight.options());
    at::parallel_for(0, count, 1, [&](int64_t begin, int64_t end) {
      for (int64_t i = begin; i < end; ++i) {
        kernels::ConvolveNonzero(shape, batch->rasters[i], packed.data_ptr<float>(),
                                 output.data_ptr<float>() + i * output.stride(0));
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
    const int64_t outputs = kernels::PaddedOutputs(shape.outputs);
    for (at::Tensor& sum : sums) {
      sum = at::zeros({shape.kernel, shape.kernel, shape.channels, outputs}, gradient.options());
    }
    at::parallel_for(0, gradient.size(0), 1, [&](int64_t begin, int64_t end) {
      auto* const sum = sums[static_cast<size_t>(at::get_thread_num())].data_ptr<float>();
      for (int64_t i = begin; i < end; ++i) {
        kernels::AddNonzeroWeightGradient(shape, batch->rasters[i],
                                          gradient.data_ptr<float>() + i * gradient.stride(0), sum);
      }
    });
    for (size_t i = 1; i < sums.size(); ++i) sums[0] += sums[i];
    return {sums[0].narrow(3, 0, shape.outputs).permute({3, 2, 0, 1}).div_(kFullIntensity),
            Variable()};
  }
};

}  // namespace

at::Tensor ConvolveRasters(const RasterBatch& rasters, const at::Tensor& weight, int64_t stride) {
  const auto most = static_cast<int64_t>(kMostNonzero * static_cast<double>(rasters.values()));
  if (weight.is_cpu() && rasters.nonzero() <= most) {
    auto batch = c10::make_intrusive<NonzeroBatch>();
    batch->shape = {rasters.height(), rasters.width(), rasters.channels(),
                    weight.size(0),   weight.size(2),  stride};
    batch->rasters = rasters;
    return NonzeroConvolution::apply(weight, batch);
  }
  // [B, H, W, C] seen as [B, C, H, W] is channels-last, which convolutions want.
  const at::Tensor numbers = rasters.Dense()
                                 .to(weight.device())
                                 .permute({0, 3, 1, 2})
                                 .to(at::kFloat)
                                 .mul_(1.0 / kFullIntensity);
  return at::conv2d(numbers, weight, {}, stride, weight.size(2) / 2);
}

}  // namespace maneuver::learning
