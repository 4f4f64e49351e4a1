#include "model/learning/autograd/batch_norm_relu.h"

#include <torch/csrc/autograd/custom_function.h>

#include <algorithm>
#include <functional>

#include "model/kernels/batch_norm_passes.h"
#include "model/learning/parallel.h"

namespace maneuver::learning {
namespace {

using kernels::AddGradientSums;
using kernels::AddMoments;
using kernels::ChannelMap;
using kernels::ChannelSums;
using kernels::NormalizeRelu;
using kernels::PassGradientBack;
using torch::autograd::AutogradContext;
using torch::autograd::Variable;
using torch::autograd::variable_list;

constexpr int64_t kCellsPerThread = 512;  // that are worth one

// Cells with their channels next to each other, [cells, C].
struct Cells {
  explicit Cells(const at::Tensor& of)
      : grid(of.contiguous(at::MemoryFormat::ChannelsLast)),
        channels(of.size(1)),
        count(of.numel() / of.size(1)) {}

  float* at(int64_t cell) const { return grid.data_ptr<float>() + cell * channels; }

  at::Tensor grid;
  int64_t channels;
  int64_t count;
};

// Two sums of each channel over all cells, [2, C] doubles. add(begin, end, sums) adds up some
// cells. Each thread has its own sums, over cells that are the same in each run.
at::Tensor SumCells(const Cells& cells,
                    const std::function<void(int64_t, int64_t, const ChannelSums&)>& add) {
  const at::Tensor sums = at::zeros({at::get_num_threads(), 2, cells.channels}, at::kDouble);
  at::parallel_for(0, cells.count, kCellsPerThread, [&](int64_t begin, int64_t end) {
    auto* const own = sums.data_ptr<double>() + at::get_thread_num() * 2 * cells.channels;
    add(begin, end, {own, own + cells.channels});
  });
  return sums.sum(0);
}

class FusedBatchNormRelu : public torch::autograd::Function<FusedBatchNormRelu> {
 public:
  static Variable forward(AutogradContext* context, const Variable& x, const Variable& weight,
                          const Variable& bias, const at::Tensor& running_mean,
                          const at::Tensor& running_var) {
    const Cells cells(x);
    const auto count = static_cast<double>(cells.count);
    const at::Tensor shift = at::empty({cells.channels}, at::kFloat);
    std::copy_n(cells.at(0), cells.channels, shift.data_ptr<float>());  // near enough to the mean
    const at::Tensor moments = SumCells(cells,
                                        [&](int64_t begin, int64_t end, const ChannelSums& sums) {
                                          AddMoments(end - begin, cells.channels, cells.at(begin),
                                                     shift.data_ptr<float>(), sums);
                                        }) /
                               count;
    const at::Tensor variance = (moments[1] - moments[0].square()).clamp_min(0.0);
    const at::Tensor mean = moments[0] + shift;
    const at::Tensor inverse_stddev = (variance + kBatchNormEpsilon).rsqrt();
    running_mean.add_(kBatchNormMomentum * (mean - running_mean));
    running_var.add_(kBatchNormMomentum * (variance * (count / (count - 1.0)) - running_var));

    const at::Tensor scale = (weight.detach() * inverse_stddev).to(at::kFloat);
    const at::Tensor offset = (bias.detach() - mean * scale).to(at::kFloat);
    const Cells y(at::empty_like(cells.grid));
    at::parallel_for(0, cells.count, kCellsPerThread, [&](int64_t begin, int64_t end) {
      NormalizeRelu(end - begin, cells.channels, cells.at(begin),
                    {scale.data_ptr<float>(), offset.data_ptr<float>()}, y.at(begin));
    });
    context->save_for_backward({cells.grid, scale, offset, mean, inverse_stddev});
    return y.grid;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    TORCH_CHECK(!at::GradMode::is_enabled(), "batch normalisation has no second derivative here");
    const variable_list saved = context->get_saved_variables();
    const Cells x(saved[0]);
    const at::Tensor& scale = saved[1];
    const at::Tensor& offset = saved[2];
    const at::Tensor& mean = saved[3];
    const at::Tensor& inverse_stddev = saved[4];
    const ChannelMap map{scale.data_ptr<float>(), offset.data_ptr<float>()};
    const Cells y_gradient(gradients[0]);
    const at::Tensor shift = mean.to(at::kFloat);
    const at::Tensor sums = SumCells(x, [&](int64_t begin, int64_t end, const ChannelSums& part) {
      AddGradientSums(end - begin, x.channels, x.at(begin), y_gradient.at(begin), map,
                      shift.data_ptr<float>(), part);
    });
    const at::Tensor weight_gradient = sums[1] * inverse_stddev;
    const at::Tensor factor = scale / static_cast<double>(x.count);
    const at::Tensor slope = -factor * inverse_stddev * weight_gradient;
    const at::Tensor constant = (-factor * sums[0] - slope * mean).to(at::kFloat);
    const at::Tensor slope32 = slope.to(at::kFloat);
    const Cells x_gradient(at::empty_like(x.grid));
    at::parallel_for(0, x.count, kCellsPerThread, [&](int64_t begin, int64_t end) {
      PassGradientBack(end - begin, x.channels, x.at(begin), y_gradient.at(begin), map,
                       slope32.data_ptr<float>(), constant.data_ptr<float>(), x_gradient.at(begin));
    });
    return {x_gradient.grid, weight_gradient.to(at::kFloat), sums[0].to(at::kFloat), Variable(),
            Variable()};
  }
};

}  // namespace

at::Tensor BatchNormOfBatch(const at::Tensor& x, const BatchNorm& norm) {
  const bool is_single = x.numel() == x.size(1);
  return at::batch_norm(x, norm.weight, norm.bias, norm.running_mean,
                        is_single ? norm.running_var.clone() : norm.running_var,
                        /*training=*/true, kBatchNormMomentum, kBatchNormEpsilon,
                        /*cudnn_enabled=*/true);
}

at::Tensor BatchNormRelu(const at::Tensor& x, const BatchNorm& norm) {
  if (x.is_cpu() && x.numel() > x.size(1)) {
    return FusedBatchNormRelu::apply(x, norm.weight, norm.bias, norm.running_mean,
                                     norm.running_var);
  }
  return BatchNormOfBatch(x, norm).relu();
}

}  // namespace maneuver::learning
