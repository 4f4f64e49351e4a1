// Chooses some of the examples, for pictures.

#ifndef MANEUVER_MODEL_EVALUATION_EXAMPLE_SAMPLE_H_
#define MANEUVER_MODEL_EVALUATION_EXAMPLE_SAMPLE_H_

#include <cstddef>
#include <span>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "model/data/example_index.h"

namespace maneuver::evaluation {

// Returns the ascending indices of at most `count` examples: those with the smallest hash of
// scenario id, target and time. Every example is equally likely. The choice does not depend on the
// model, the order of the recordings or the number of threads.
std::vector<size_t> SampleExamples(std::span<const data::Example> examples,
                                   std::span<const v1::Scenario> recordings, size_t count);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_EXAMPLE_SAMPLE_H_
