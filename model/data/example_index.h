// Selects the (target, time) pairs of recordings that become examples.

#ifndef MANEUVER_MODEL_DATA_EXAMPLE_INDEX_H_
#define MANEUVER_MODEL_DATA_EXAMPLE_INDEX_H_

#include <cstdint>
#include <span>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/scene/pose2.h"
#include "model/scene/target_motion.h"

namespace maneuver::data {

// One (target, time) pair. Does not copy the recording.
struct Example {
  int recording = 0;  // index into the recordings
  int64_t target_id = 0;
  double time = 0.0;  // replaces the scenario's prediction_time
  scene::Pose2 X_WT;
  std::vector<float> trajectory;  // [T, 2] target frame, metres
  bool standing = false;
  scene::MotionInputs motion{};
  // The trajectory reference r(m) that the model's trajectories are measured from, [T, 2] target
  // frame, metres; empty for a model without one.
  std::vector<float> reference;
};

// Enumerates the examples of one recording, ordered by agent, then by time. Spec and settings must
// be complete (no unset fields). Without a stride there are no examples.
//
// Example times lie on a grid: multiples of the stride on the scenario's clock. At each, the
// target's nearest state within half a frame interval counts. The grid does not start with each
// track, so one track never moves the examples of another. An example needs
//   - a target of a type that the spec learns from (ModelSpec.target_types), all of whose states
//     are possible (scene::IsPhysicallyPossible);
//   - a past: a state at the oldest of the history_frames, within half a frame interval, and no gap
//     (scene::ObservationWindow::max_gap) since then;
//   - a future without gaps at its waypoints;
//   - no step in that time faster than max_speed (if above 0) or than its type can move
//     (MostSpeed): a faster one is a tracking error.
// A target is standing if all its waypoints lie within standing_distance of its position. This is a
// distance, not a path length: sensor noise alone adds up to metres of path. Most standing vehicles
// are parked, so each is kept only with probability keep_standing. A hash of scenario id, target
// and time decides, so the same windows stay whatever else is in the dataset. All standing
// pedestrians and cyclists are kept: they do not park, and few of them stand.
//   standing_seen: if given, incremented for each standing window, kept or not.
std::vector<Example> EnumerateExamples(const v1::Scenario& recording, int recording_index,
                                       const v1::ModelSpec& spec,
                                       const v1::ExampleSettings& settings,
                                       int64_t* standing_seen = nullptr);

// Returns the speed that no agent of a type exceeds, m/s: 10 for pedestrians, 25 for cyclists,
// infinity for others.
double MostSpeed(v1::AgentType type);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_EXAMPLE_INDEX_H_
