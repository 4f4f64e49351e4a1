#include "model/learning/phases/micro_batches.h"

#include <utility>

namespace maneuver::learning {

MicroBatches::MicroBatches(const MicroBatchRange& range, RankGroup& ranks, AdamW& optimizer,
                           std::vector<at::Tensor> averaged)
    : range_(range),
      ranks_(ranks),
      parameters_(optimizer.Parameters()),
      averaged_(std::move(averaged)) {
  for (const at::Tensor& each : parameters_) size_ += each.numel();
  for (const at::Tensor& each : averaged_) size_ += each.numel();
  size_ += static_cast<int64_t>(parameters_.size());
  constexpr int64_t kMultiple = RankGroup::kSumMultiple;
  size_ = (size_ + kMultiple - 1) / kMultiple * kMultiple;
}

absl::Status MicroBatches::Compute(const LossOf& loss_of) {
  before_.clear();
  for (const at::Tensor& each : averaged_) before_.push_back(each.clone());
  absl::StatusOr<at::Tensor> sum = SumOf(range_.first, range_.count, loss_of);
  if (!sum.ok()) return sum.status();
  sum_ = *std::move(sum);
  return absl::OkStatus();
}

absl::Status MicroBatches::Combine() {
  const absl::Status status = ranks_.SumByTree(&sum_);
  if (!status.ok()) return status;
  at::NoGradGuard no_grad;
  int64_t offset = 0;
  for (const at::Tensor& each : parameters_) {
    each.mutable_grad() = Part(sum_, each, offset);
    offset += each.numel();
  }
  for (size_t i = 0; i < averaged_.size(); ++i) {
    averaged_[i].copy_(before_[i] + Part(sum_, averaged_[i], offset));
    offset += averaged_[i].numel();
  }
  const at::Tensor have = sum_.slice(0, offset, offset + static_cast<int64_t>(parameters_.size()));
  const at::Tensor have_on_cpu = have.cpu();
  for (size_t i = 0; i < parameters_.size(); ++i) {
    if (have_on_cpu.data_ptr<float>()[i] == 0.0F) parameters_[i].mutable_grad().reset();
  }
  return absl::OkStatus();
}

absl::StatusOr<at::Tensor> MicroBatches::SumOf(int first, int count, const LossOf& loss_of) {
  if (count == 1) return GradientOf(first, loss_of);
  absl::StatusOr<at::Tensor> sum = SumOf(first, count / 2, loss_of);
  if (!sum.ok()) return sum;
  const absl::StatusOr<at::Tensor> rest = SumOf(first + count / 2, count / 2, loss_of);
  if (!rest.ok()) return rest;
  sum->add_(*rest);
  return sum;
}

absl::StatusOr<at::Tensor> MicroBatches::GradientOf(int micro_batch, const LossOf& loss_of) {
  const absl::StatusOr<BatchLoss> loss = loss_of(micro_batch);
  if (!loss.ok()) return loss.status();
  at::Tensor gradient = at::zeros({size_}, at::TensorOptions(parameters_.front().device()));
  if (loss->examples == 0) return gradient;
  (loss->value * loss->share).backward();
  at::NoGradGuard no_grad;
  int64_t offset = 0;
  for (const at::Tensor& each : parameters_) {
    if (each.grad().defined()) Part(gradient, each, offset).copy_(each.grad());
    offset += each.numel();
  }
  for (size_t i = 0; i < averaged_.size(); ++i) {
    Part(gradient, averaged_[i], offset).copy_((averaged_[i] - before_[i]) * loss->share);
    averaged_[i].copy_(before_[i]);
    offset += averaged_[i].numel();
  }
  std::vector<float> have;
  for (const at::Tensor& each : parameters_) {
    have.push_back(each.grad().defined() ? 1.0F : 0.0F);
    each.mutable_grad().reset();
  }
  gradient.slice(0, offset, offset + static_cast<int64_t>(have.size()))
      .copy_(at::tensor(at::ArrayRef<float>(have), at::kFloat));
  return gradient;
}

at::Tensor MicroBatches::Part(const at::Tensor& sum, const at::Tensor& like, int64_t offset) {
  // With the strides of a dense tensor, the optimizer reads it in step with the parameter.
  return sum.as_strided(like.sizes(), like.strides(), offset);
}

}  // namespace maneuver::learning
