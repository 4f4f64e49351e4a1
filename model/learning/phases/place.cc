#include "model/learning/phases/place.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "model/data/stable_hash.h"
#include "model/learning/epoch_size.h"
#include "model/learning/example_order.h"
#include "model/learning/mixture_placement.h"
#include "model/learning/phases/mixture.h"

namespace maneuver::learning {
namespace {

constexpr int64_t kMostClustered = 16'384;  // examples

// Examples that mixtures are placed by, with the label of each (-1: none) if there are labels.
EncodedExamples EncodeForPlacement(const LearningState& state, std::vector<int>* labels) {
  at::NoGradGuard no_grad;
  const int64_t count = std::min(state.trajectories.size(0), kMostClustered);
  const at::Tensor drawn =
      SpreadExamples(DatasetSizes(state.data), DatasetWeights(state.settings), count);
  at::Tensor placed = state.trajectories.index_select(0, drawn);
  labels->clear();
  if (!state.data.labels.empty()) {
    for (int64_t i = 0; i < count; ++i) {
      labels->push_back(state.data.labels[static_cast<size_t>(drawn[i].item<int64_t>())]);
    }
  }
  // Where left and right are swapped at random, clusters are of both sides.
  if (state.settings.augmentation().mirror()) {
    at::Tensor mirrored = placed.clone().view({count, -1, 2});
    mirrored.select(2, 1).neg_();
    placed = at::cat({placed, mirrored.flatten(1)});
    // A mirrored left turn is not one.
    labels->resize(labels->empty() ? 0 : static_cast<size_t>(placed.size(0)), -1);
  }
  const Gaussian q_z = state.networks.EncodeTrajectories(placed.to(state.networks.device()));
  return {placed, ScaleOf(state.settings), {q_z.mean.cpu(), q_z.log_variance.cpu()}};
}

void PlaceOnce(const EncodedExamples& examples, const std::vector<int>& labels, uint64_t seed,
               LearningState& state) {
  at::NoGradGuard no_grad;
  const v1::OptimizationSettings& optimization = state.settings.optimization();
  const PlacedMixture placed = PlaceLabelledMixture(
      optimization.mixture_placement(), examples, labels,
      static_cast<int>(state.data.label_names.size()), state.settings.model().actions(), seed);
  Networks& networks = state.networks;
  state.centers = placed.centers;
  networks["mixture.mean"].copy_(placed.components.mean);
  networks["mixture.log_variance"].copy_(placed.components.log_variance);
  networks["mixture.log_weight"].copy_(placed.log_weights);
  if (optimization.weight_concentration() > 0.0) {
    // With a prior, the logarithms of its counts instead.
    networks["mixture.log_weight"].add_(std::log(state.observations));
  }
}

}  // namespace

uint64_t PlacementSeed(uint64_t seed, int placement) {
  if (placement == 0) return seed;
  return data::MixHash(data::SplitMix64(seed), static_cast<uint64_t>(placement));
}

absl::Status ChoosePlacement(LearningState& state, EpochLoop& loop) {
  if (state.stopped()) return absl::CancelledError("training was stopped");
  std::vector<int> labels;
  const EncodedExamples examples = EncodeForPlacement(state, &labels);
  const uint64_t seed = static_cast<uint64_t>(state.settings.seed());
  const int placements = state.settings.optimization().placements();
  if (placements == 1) {
    PlaceOnce(examples, labels, seed, state);
    return absl::OkStatus();
  }
  const Networks::Snapshot pretrained = state.networks.Save();
  Networks::Snapshot best;
  at::Tensor best_centers;
  double best_loss = HUGE_VAL;
  loop.progress().BeginPhase(kPlacePhase);
  for (int i = 0; i < placements; ++i) {
    state.networks.Restore(pretrained);
    PlaceOnce(examples, labels, PlacementSeed(seed, i), state);
    const absl::StatusOr<double> loss = TryMixture(kPlacePhase, kPlacementEpochs, state, loop);
    if (!loss.ok()) return loss.status();
    if (i == 0 || *loss < best_loss) {
      best_loss = *loss;
      best = state.networks.Save();
      best_centers = state.centers;
    }
  }
  state.networks.Restore(best);
  state.centers = best_centers;
  return absl::OkStatus();
}

}  // namespace maneuver::learning
