// Tells how long a measurement will take. No LibTorch in this header.

#ifndef MANEUVER_MODEL_LEARNING_MEASURING_TIME_H_
#define MANEUVER_MODEL_LEARNING_MEASURING_TIME_H_

#include <chrono>
#include <cstdint>
#include <optional>

#include "model/learning/training_progress.h"

namespace maneuver::learning {

// Extrapolates the first examples of a measurement to all of them. Not thread-safe.
class MeasuringTime {
 public:
  // Begins a measurement.
  explicit MeasuringTime(TrainingProgress::Clock clock);

  // To be called as EvaluationInput.progress. Returns false, so that the measurement stops, once it
  // has seen a second of examples.
  bool Continue(int64_t done, int64_t total);

  // Returns the seconds that `examples` examples take: the time before the first one, plus the time
  // of one example for each. Nothing before Continue was called twice.
  std::optional<double> SecondsOf(int64_t examples) const;
  // The same for all examples of the measurement.
  std::optional<double> Seconds() const { return SecondsOf(total_); }

 private:
  struct Moment {
    double seconds = 0.0;  // after the beginning
    int64_t done = 0;      // examples
  };

  const TrainingProgress::Clock clock_;
  const std::chrono::system_clock::time_point begun_;
  std::optional<Moment> first_;
  Moment last_;
  int64_t total_ = 0;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_MEASURING_TIME_H_
