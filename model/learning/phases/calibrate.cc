#include "model/learning/phases/calibrate.h"

#include "model/learning/calibration.h"

namespace maneuver::learning {

absl::Status Calibrate(LearningState& state, EpochLoop& loop) {
  loop.progress().BeginPhase(kCalibratePhase);
  loop.progress().BeginEpoch(1);
  return CalibrateModel(state.networks, state.training, state.validation,
                        CalibrationSample(state.settings.model(), state.data),
                        state.settings.optimization(), state.threads, state.generator,
                        state.stopped,
                        [&loop](int64_t examples) { loop.progress().Step(examples); });
}

}  // namespace maneuver::learning
