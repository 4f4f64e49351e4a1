// What the phases of a run share.

#ifndef MANEUVER_MODEL_LEARNING_PHASES_LEARNING_STATE_H_
#define MANEUVER_MODEL_LEARNING_PHASES_LEARNING_STATE_H_

#include <functional>

#include "checkpoint.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/networks.h"
#include "model/learning/scene_bound.h"
#include "model/learning/scene_source.h"
#include "model/learning/tensors.h"
#include "model/learning/training_data.h"

namespace maneuver::learning {

// The data, the networks and the random numbers of one run. The phases change the networks, the
// generator and the centres, and nothing else. Not thread-safe.
struct LearningState {
  // Draws fresh weights, standardizes the networks on the training examples, and indexes all maps.
  //   run_settings: complete;  run_data: must outlive the state
  //   run_threads: number of threads that read maps and scenes;  is_stopped: asked often, from
  //   several threads
  LearningState(const v1::TrainingSettings& run_settings, const TrainingData& run_data,
                at::Device device, int run_threads, std::function<bool()> is_stopped);
  LearningState(const LearningState&) = delete;
  LearningState& operator=(const LearningState&) = delete;

  // Draws standard normal numbers, on the device of the networks.
  at::Tensor Noise(at::IntArrayRef shape);
  NoiseSource NoiseDrawn();

  // Store adds networks and centres to a checkpoint; Restore reads them from one.
  void Store(Checkpoint* checkpoint) const;
  void Restore(const Checkpoint& checkpoint);

  const v1::TrainingSettings settings;
  const TrainingData& data;
  const int threads;
  const std::function<bool()> stopped;
  const SceneSource training;
  const SceneSource validation;
  at::Generator generator;
  Networks networks;
  // Centres of the clusters that the mixture was placed by, those of the last actions
  // (PlacedMixture); undefined if there are none.
  at::Tensor centers;
  // Number of tracks that the training examples come from. Windows of one track resemble each
  // other, so the number of examples would overstate what was observed.
  const double observations;
  const at::Tensor trajectories;             // x - r(m) of training, [N, 2T] metres, on the CPU
  const at::Tensor validation_trajectories;  // [V, 2T]
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_LEARNING_STATE_H_
