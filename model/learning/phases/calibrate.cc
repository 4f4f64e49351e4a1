#include "model/learning/phases/calibrate.h"

#include "model/learning/run_examples.h"

namespace maneuver::learning {

absl::Status Calibrate(LearningState& state, EpochLoop& loop) {
  loop.progress().BeginPhase(kCalibratePhase);
  loop.progress().BeginEpoch(1);
  return CalibrateBy(CountRunExamples(state.settings.model(), state.data).Calibrated(), state,
                     StepsOf(loop.progress()));
}

absl::Status CalibrateBy(const CalibrationExamples& most, LearningState& state,
                         const CountCalibrationStep& count) {
  return CalibrateModel(state.networks, state.training, state.validation,
                        state.settings.optimization(),
                        {most, state.threads, state.generator, state.stopped, count});
}

}  // namespace maneuver::learning
