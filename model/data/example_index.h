// Which (target, time) pairs of the recordings become examples.

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

// One (target, time) pair. Never holds a copy of the recording.
struct Example {
  int recording = 0;  // index into the recordings
  int64_t target_id = 0;
  double time = 0.0;  // stands in for the scenario's prediction_time
  scene::Pose2 X_WT;
  std::vector<float> trajectory;  // [T, 2] target frame, metres
  bool standing = false;
  scene::MotionInputs motion{};
  // r(m), what a model's trajectories are measured from, [T, 2] target frame, metres; empty for a
  // model without a reference.
  std::vector<float> reference;
};

// Two states that are further apart than this many frame intervals have a gap between them: one
// frame may be missing, two may not.
inline constexpr double kMaxGapFrames = 2.5;

// Enumerates the examples of one recording, in the order of its agents, then of time. Spec and
// settings are complete (no unset fields); without a stride there are no examples.
//
// Times are the target's states nearest to the multiples of the stride on the scenario's clock (not
// counted from where a track begins: what one track does moves nobody else's examples), if within
// half a frame interval of them. An example needs
//   - a target of a type that the spec learns from (ModelSpec.target_types);
//   - a past: a state at the oldest of the history_frames, within half a frame interval, and no gap
//     since;
//   - a future without gaps over the whole horizon;
//   - no step over that time faster than max_speed (if that is above 0) or than its type ever is
//     (MostSpeed): it is mistracked.
// A target whose waypoints all lie within standing_distance of where it is stands (a distance and
// not a path length: sensor noise alone adds up to metres of path). Most standing vehicles are
// parked: they are kept with probability keep_standing, decided by a hash of scenario id, target
// and time (so that the same windows stay whatever else is in the dataset). Standing pedestrians
// and cyclists are all kept: they do not park, and few of them stand.
//   standing_seen: incremented for each standing window, kept or not, if given.
std::vector<Example> EnumerateExamples(const v1::Scenario& recording, int recording_index,
                                       const v1::ModelSpec& spec,
                                       const v1::ExampleSettings& settings,
                                       int64_t* standing_seen = nullptr);

// Returns what no agent of a type is faster than, metres per second: 10 for pedestrians, 25 for
// cyclists, infinite for others.
double MostSpeed(v1::AgentType type);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_EXAMPLE_INDEX_H_
