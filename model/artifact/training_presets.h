// The named presets of training settings, and their rules. Here and not in learning/, so that the
// server can check a Train request without LibTorch.

#ifndef MANEUVER_MODEL_ARTIFACT_TRAINING_PRESETS_H_
#define MANEUVER_MODEL_ARTIFACT_TRAINING_PRESETS_H_

#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/scene/field_violation.h"

namespace maneuver::artifact {

// `settings` with every unset field taken from its preset. Where it names none, that is "lanes", or
// "compact" if it has a raster, a backbone or target_motion. Repeated fields replace the preset's
// whole. Widths of scene_vectors that are set to 0 turn off what the preset has, as does
// action_geometry.pair_width 0. An unknown preset is left as it is, for validation to find.
v1::TrainingSettings ResolveTrainingSettings(const v1::TrainingSettings& settings);

// The same for a run that starts from a model of this spec, which stands in for the preset's; only
// the objective may be another one.
v1::TrainingSettings ResolveTrainingSettings(const v1::TrainingSettings& settings,
                                             const v1::ModelSpec& start);

// What is wrong with resolved settings (fields named from them: model.actions, ...).
std::vector<scene::FieldViolation> ValidateTrainingSettings(const v1::TrainingSettings& resolved);

// What in settings that are not resolved yet does not go with a start from a model of this spec.
std::vector<scene::FieldViolation> ValidateStart(const v1::TrainingSettings& settings,
                                                 const v1::ModelSpec& start);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_TRAINING_PRESETS_H_
