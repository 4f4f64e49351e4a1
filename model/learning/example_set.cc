#include "model/learning/example_set.h"

namespace maneuver::learning {

v1::ExampleSettings TrainingExampleSettings(const v1::TrainingSettings& settings) {
  v1::ExampleSettings examples = settings.examples();
  if (examples.has_training_stride()) *examples.mutable_stride() = examples.training_stride();
  return examples;
}

}  // namespace maneuver::learning
