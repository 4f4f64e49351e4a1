// Which (target, time) pairs of the recordings become examples.

#ifndef MANEUVER_MODEL_DATA_EXAMPLE_INDEX_H_
#define MANEUVER_MODEL_DATA_EXAMPLE_INDEX_H_

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/scene/pose2.h"

namespace maneuver::data {

// One (target, time) pair. Never holds a copy of the recording.
struct Example {
  int recording = 0;  // index into the recordings
  int64_t target_id = 0;
  double time = 0.0;  // stands in for the scenario's prediction_time
  scene::Pose2 X_WT;
  std::vector<float> trajectory;  // [T, 2] target frame, metres
  bool standing = false;
};

// Enumerates the examples of one recording: vehicle targets, a state at `time` and one second
// before it, a future without gaps over the whole horizon, no step faster than max_speed. Standing
// targets are kept with probability keep_standing, decided by a hash of scenario id, target and time
// (so that the same windows stay whatever else is in the dataset).
//   standing_seen: incremented for each standing window, kept or not, if given.
std::vector<Example> EnumerateExamples(const v1::Scenario& recording, int recording_index,
                                       const v1::ModelSpec& spec,
                                       const v1::ExampleSettings& settings,
                                       int64_t* standing_seen = nullptr);

// Whether a recording is held out for validation: by a hash of its id, so that it is on the same side
// in every run and in every dataset. Recordings of one place in parts ("id#1", "id#2") go together:
// the hash stops at '#'.
bool HeldOut(const std::string& scenario_id, double validation_share);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_EXAMPLE_INDEX_H_
