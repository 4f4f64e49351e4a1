#include "model/learning/phases/trajectory_phase.h"

#include <ATen/Parallel.h>

#include <algorithm>

#include "model/learning/epoch_size.h"
#include "model/learning/validation.h"

namespace maneuver::learning {
namespace {

// Sets LibTorch to one thread while it lives.
class OneThread {
 public:
  OneThread() : before_(at::get_num_threads()) { at::set_num_threads(1); }
  ~OneThread() { at::set_num_threads(before_); }
  OneThread(const OneThread&) = delete;
  OneThread& operator=(const OneThread&) = delete;

 private:
  const int before_;
};

class TrajectorySteps final : public EpochSteps {
 public:
  TrajectorySteps(const TrajectoryPhase& phase, int64_t batch_size, LearningState& state)
      : phase_(phase), batch_size_(batch_size), state_(state) {
    const std::vector<int>& labels = state.data.labels;
    if (!labels.empty()) labels_ = at::tensor(at::ArrayRef<int>(labels), at::kLong);
  }

  absl::Status BeginEpoch(const EpochStart& start) override {
    order_ = start.order;
    step_ = start.step;
    return absl::OkStatus();
  }

  absl::StatusOr<BatchLoss> Next(const StepContext& context, TermMeans* means) override {
    const size_t begin = static_cast<size_t>(step_++ * batch_size_);
    const std::span<const int64_t> batch =
        order_.subspan(begin, std::min(static_cast<size_t>(batch_size_), order_.size() - begin));
    const at::Tensor rows =
        at::tensor(at::ArrayRef<int64_t>(batch.data(), batch.size()), at::kLong);
    return BatchLoss{phase_.loss(Vary(rows), context, means), rows.size(0)};
  }

  void EndEpoch(v1::EpochReport* report) override {
    ValidateBase(state_.networks, state_.validation_trajectories, phase_.has_mixture, report);
    if (phase_.report) phase_.report(*report);
  }

 private:
  // Returns some of the training examples, scaled and mirrored at random.
  //   rows: [B] indices
  TrajectoryBatch Vary(const at::Tensor& rows) {
    const v1::AugmentationSettings& augmentation = state_.settings.augmentation();
    const int64_t batch = rows.size(0);
    at::Tensor labels = labels_.defined() ? labels_.index_select(0, rows) : labels_;
    const at::Tensor scale =
        at::empty({batch, 1, 1}, at::kFloat)
            .uniform_(1.0 - augmentation.scale(), 1.0 + augmentation.scale(), state_.generator);
    at::Tensor varied = state_.trajectories.index_select(0, rows).view({batch, -1, 2}) * scale;
    if (augmentation.mirror()) {
      const at::Tensor side =
          at::empty({batch, 1}, at::kFloat).bernoulli_(0.5, state_.generator).mul_(2.0).sub_(1.0);
      varied.select(2, 1).mul_(side);
      if (labels.defined()) labels = labels.masked_fill(side.squeeze(1) < 0.0, -1);
    }
    const at::Device device = state_.networks.device();
    return {varied.flatten(1).to(device), labels.defined() ? labels.to(device) : labels};
  }

  const TrajectoryPhase& phase_;
  const int64_t batch_size_;
  LearningState& state_;
  at::Tensor labels_;  // TrainingData.labels, [N]; undefined if there are none
  std::span<const int64_t> order_;
  int64_t step_ = 0;
};

}  // namespace

absl::Status LearnFromTrajectories(const TrajectoryPhase& phase, LearningState& state,
                                   EpochLoop& loop) {
  const OneThread one_thread;
  const v1::OptimizationSettings& optimization = state.settings.optimization();
  AdamW optimizer;
  for (const Networks::Part part : phase.parts) {
    optimizer.Add(state.networks.Parameters(part), state.networks.Decays(part),
                  optimization.learning_rate(), optimization.weight_decay());
  }
  const int64_t batch_size = optimization.batch_size() * kTrajectoryBatchFactor;
  TrajectorySteps steps(phase, batch_size, state);
  return loop.Run(
      {phase.name, phase.epochs, batch_size, state.trajectories.size(0), phase.resumable},
      {state.generator, optimizer, [&state](Checkpoint* checkpoint) { state.Store(checkpoint); }},
      steps);
}

}  // namespace maneuver::learning
