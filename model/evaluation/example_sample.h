// Chooses some of the examples, for pictures.

#ifndef MANEUVER_MODEL_EVALUATION_EXAMPLE_SAMPLE_H_
#define MANEUVER_MODEL_EVALUATION_EXAMPLE_SAMPLE_H_

#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>

#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_service.pb.h"
#include "model/data/example_index.h"
#include "model/evaluation/measurement.h"

namespace maneuver::evaluation {

// Keeps the examples with the smallest hash of scenario id, target and time. Every example is
// equally likely. The choice does not depend on the model, the order of the recordings or the
// number of threads.
class ExampleSample {
 public:
  //   count: how many examples are kept, at most
  explicit ExampleSample(size_t count) : count_(count) {}

  //   recording: the recording that contains the example
  void Add(const v1::Scenario& recording, const data::Example& example,
           const Measurement& measured);

  // Adds the examples that were kept to the report, in the order in which they came.
  void Write(v1::EvaluationReport& report) const;

 private:
  size_t count_;
  int64_t seen_ = 0;
  std::map<std::pair<uint64_t, int64_t>, v1::EvaluatedExample> kept_;  // by hash, then by order
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_EXAMPLE_SAMPLE_H_
