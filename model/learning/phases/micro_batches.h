// Computes the gradient of a batch from micro-batches, on any number of ranks with the same bits.

#ifndef MANEUVER_MODEL_LEARNING_PHASES_MICRO_BATCHES_H_
#define MANEUVER_MODEL_LEARNING_PHASES_MICRO_BATCHES_H_

#include <cstdint>
#include <functional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/learning/optimizer.h"
#include "model/learning/phases/batch_loss.h"
#include "model/learning/ranks/micro_batch_range.h"
#include "model/learning/ranks/rank_group.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// The gradient of a batch is the sum of those of its micro-batches, each weighted by its share of
// the examples. They are added in a tree of pairs whose shape depends on their number alone: each
// rank adds up its own micro-batches, and RankGroup::SumByTree adds up the ranks.
//
// Batch normalisation uses the moments of its micro-batch. Running moments take the same weighted
// mean as the gradients. Not thread-safe.
class MicroBatches {
 public:
  //   averaged: the tensors that a micro-batch changes without a gradient: running moments
  MicroBatches(const MicroBatchRange& range, RankGroup& ranks, AdamW& optimizer,
               std::vector<at::Tensor> averaged);

  // Computes the loss of the micro-batch with this index. The loss of an empty one is ignored.
  using LossOf = std::function<absl::StatusOr<BatchLoss>(int micro_batch)>;

  // Adds up the gradients of this rank's micro-batches. Errors are those of `loss_of`.
  absl::Status Compute(const LossOf& loss_of);
  // Adds up what all ranks have computed, and sets the gradients of the parameters and the running
  // moments. Errors are those of RankGroup.
  absl::Status Combine();

 private:
  // Returns the sum over `count` micro-batches from `first` on. `count` is a power of two. [N]
  absl::StatusOr<at::Tensor> SumOf(int first, int count, const LossOf& loss_of);
  absl::StatusOr<at::Tensor> GradientOf(int micro_batch, const LossOf& loss_of);
  // Returns the part of `sum` that begins at `offset`, with the size and shape of `like`.
  static at::Tensor Part(const at::Tensor& sum, const at::Tensor& like, int64_t offset);

  const MicroBatchRange range_;
  RankGroup& ranks_;
  const std::vector<at::Tensor> parameters_;
  const std::vector<at::Tensor> averaged_;
  int64_t size_ = 0;  // N: parameters, averaged tensors, which parameters have a gradient, padding
  std::vector<at::Tensor> before_;  // values of averaged_ before the batch
  at::Tensor sum_;                  // [N]
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_MICRO_BATCHES_H_
