// The named presets of training settings, and their rules. They are here and not in learning/, so
// that the server can check a Train request without LibTorch.

#ifndef MANEUVER_MODEL_ARTIFACT_TRAINING_PRESETS_H_
#define MANEUVER_MODEL_ARTIFACT_TRAINING_PRESETS_H_

#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/scene/field_violation.h"

namespace maneuver::artifact {

// The value of optimization.micro_batches when ranks train together and the settings leave it 0.
inline constexpr int kMicroBatchesOfRanks = 8;

// The shortest time from one example of a target to the next that any settings or request may ask
// for, seconds.
inline constexpr double kLeastStride = 0.01;

// Returns `settings` with every unset field filled in from its preset. Without a preset's name,
// that is "lanes", or "compact" if the settings have a raster, a backbone or target_motion. A
// repeated field replaces the preset's as a whole. A width of scene_vectors set to 0, or
// action_geometry.pair_width 0, turns off that part of the preset. Also fills in what the settings
// then need: posterior epochs for OBJECTIVE_DUAL, a network for DECODER_COVARIANCE_PREDICTED. Drops
// the preset's scene_covariance if decoder_covariance asks for another kind. An unknown preset is
// left for validation to report.
//
// A model that is described whole, from its inputs to its trajectories, does not take
// action_geometry from the preset. So settings that were resolved before stay the same.
v1::TrainingSettings ResolveTrainingSettings(const v1::TrainingSettings& settings);

// Does the same for a training that starts from a model of this spec, which replaces the preset's
// spec. Only the objective may differ.
v1::TrainingSettings ResolveTrainingSettings(const v1::TrainingSettings& settings,
                                             const v1::ModelSpec& start);

// Returns what is wrong with resolved settings. Field paths start there: model.actions, ...
std::vector<scene::FieldViolation> ValidateTrainingSettings(const v1::TrainingSettings& resolved);

// Returns what in unresolved settings contradicts a start from a model of this spec.
std::vector<scene::FieldViolation> ValidateStart(const v1::TrainingSettings& settings,
                                                 const v1::ModelSpec& start);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_TRAINING_PRESETS_H_
