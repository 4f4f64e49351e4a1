// The examples of some recordings, and the settings by which training enumerates them. No LibTorch
// in this header.

#ifndef MANEUVER_MODEL_LEARNING_EXAMPLE_SET_H_
#define MANEUVER_MODEL_LEARNING_EXAMPLE_SET_H_

#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/data/example_index.h"

namespace maneuver::learning {

// Recordings of one side of the split, and the examples in them.
struct ExampleSet {
  std::vector<v1::Scenario> recordings;
  std::vector<data::Example> examples;  // Example.recording is an index into `recordings`
};

// Returns the settings by which training examples are enumerated. Their stride may differ from that
// of held-out examples.
//   settings: complete
v1::ExampleSettings TrainingExampleSettings(const v1::TrainingSettings& settings);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_EXAMPLE_SET_H_
