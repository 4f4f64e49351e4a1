// Varies training examples.

#ifndef MANEUVER_MODEL_LEARNING_VARIATION_H_
#define MANEUVER_MODEL_LEARNING_VARIATION_H_

#include <cstdint>
#include <functional>
#include <span>

#include "maneuver/v1/training_settings.pb.h"
#include "model/scene/target_history.h"
#include "model/scene/target_motion.h"

namespace maneuver::learning {

// The variation of an example. The default changes nothing.
struct Variation {
  bool mirror = false;
  double scale = 1.0;
  double shift_x = 0.0;           // pixels, only in the raster
  double shift_y = 0.0;           // pixels, only in the raster
  double rotation = 0.0;          // radians that the target's frame turns relative to the world
  double drop_agents = 0.0;       // share of the other agents that are left out
  uint64_t drop_seed = 0;         // which ones
  int frames = INT32_MAX;         // latest frames that show agents, the present one included
  scene::SensorNoise noise = {};  // on the target's history, only in the scene vectors
};

// Returns the variation of an example in an epoch. It depends only on its arguments, so the order
// of calls and the threads do not matter. Sensor noise has standard deviations of .03 to .5 m/s and
// of .001 to .02 radians, each drawn evenly in its logarithm.
//   history_frames: frames that the model reads, the present one included
Variation DrawVariation(const v1::AugmentationSettings& settings, int history_frames, uint64_t seed,
                        int epoch, int64_t example);

// Turns, scales and mirrors x as the variation says. In place, [T, 2] target frame, metres.
void ApplyVariation(const Variation& variation, std::span<float> trajectory);

// Returns the target's motion after the variation.
scene::MotionInputs VariedMotion(const Variation& variation, const scene::MotionInputs& motion);

// Returns which agents a variation leaves out of the raster; empty if it leaves out none.
std::function<bool(int64_t agent_id)> HiddenAgents(const Variation& variation);

// Returns whether a variation leaves out the agent that is the `place`-th nearest, from 0, of those
// that scene vectors describe (agent_inputs.h). Raster and vectors are drawn independently.
bool IsLeftOut(const Variation& variation, int place);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_VARIATION_H_
