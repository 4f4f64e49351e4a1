// How far back a model looks, and how far a state's time may be from the wanted time.

#ifndef MANEUVER_MODEL_SCENE_OBSERVATION_WINDOW_H_
#define MANEUVER_MODEL_SCENE_OBSERVATION_WINDOW_H_

#include "maneuver/v1/model_spec.pb.h"

namespace maneuver::scene {

// All times in seconds.
struct ObservationWindow {
  double past = 1.0;             // from the oldest frame to the prediction time
  double frame_interval = 0.25;  // between two frames

  // Returns how far a state's time may lie from the time that it stands for.
  double tolerance() const { return 0.5 * frame_interval; }
  // Returns the longest time between two states without a gap between them: one frame may be
  // missing, two may not.
  double max_gap() const { return 2.5 * frame_interval; }
};

// Returns a model's window: its raster's frames, or the default for a model without a raster.
ObservationWindow WindowOf(const v1::ModelSpec& spec);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_OBSERVATION_WINDOW_H_
