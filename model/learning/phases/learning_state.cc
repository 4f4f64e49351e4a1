#include "model/learning/phases/learning_state.h"

#include <set>
#include <span>
#include <utility>

#include "model/learning/checkpoint_contents.h"
#include "model/learning/validation.h"

namespace maneuver::learning {
namespace {

double CountTracks(std::span<const data::Example> examples) {
  std::set<std::pair<int, int64_t>> tracks;
  for (const data::Example& example : examples) {
    tracks.emplace(example.recording, example.target_id);
  }
  return static_cast<double>(tracks.size());
}

}  // namespace

LearningState::LearningState(const v1::TrainingSettings& run_settings, const TrainingData& run_data,
                             at::Device device, int run_threads, std::function<bool()> is_stopped)
    : settings(run_settings),
      data(run_data),
      threads(run_threads),
      stopped(std::move(is_stopped)),
      training(settings.model(), data.training, threads),
      validation(settings.model(), data.validation, threads),
      generator(MakeGenerator(static_cast<uint64_t>(settings.seed()))),
      networks(settings.model(), device, generator),
      observations(CountTracks(data.training.examples)),
      trajectories(Trajectories(data.training.examples)),
      validation_trajectories(Trajectories(data.validation.examples)) {
  networks.Standardize(trajectories, settings.augmentation().mirror());
}

at::Tensor LearningState::Noise(at::IntArrayRef shape) {
  return at::empty(shape, at::kFloat).normal_(0.0, 1.0, generator).to(networks.device());
}

NoiseSource LearningState::NoiseDrawn() {
  return [this](at::IntArrayRef shape) { return Noise(shape); };
}

void LearningState::Store(Checkpoint* checkpoint) const {
  StoreNetworks(networks, checkpoint);
  if (centers.defined()) *checkpoint->mutable_centers() = StoreTensor(centers);
}

void LearningState::Restore(const Checkpoint& checkpoint) {
  RestoreNetworks(checkpoint, &networks);
  if (checkpoint.has_centers()) centers = RestoreTensor(checkpoint.centers());
}

}  // namespace maneuver::learning
