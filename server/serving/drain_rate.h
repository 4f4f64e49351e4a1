// Measures how fast the workers empty the queue, by their work of the last seconds.
//
// It has neither a lock nor a clock: the batch scheduler calls it under its own lock and passes the
// time.

#ifndef MANEUVER_SERVER_SERVING_DRAIN_RATE_H_
#define MANEUVER_SERVER_SERVING_DRAIN_RATE_H_

#include <chrono>
#include <cstddef>
#include <vector>

#include "server/serving/prediction_call.h"

namespace maneuver::serving {

class DrainRate {
 public:
  explicit DrainRate(int workers) : at_work_(static_cast<size_t>(workers)) {}

  // Record that a worker begins a batch of `targets` > 0, and that it ends the batch.
  //   worker: 0 .. workers-1
  void Begin(int worker, size_t targets, TimePoint now);
  void End(int worker, TimePoint now);

  // Returns whether every worker is busy.
  bool AllAtWork() const;
  // Returns how long all workers together need for the rest of the batches in progress, at the
  // measured speed; never negative.
  std::chrono::nanoseconds TimeForWorkBegun(TimePoint now) const;

  // Returns how long all workers together need for `targets` targets. A batch that already takes
  // longer than earlier ones counts before it ends. Returns 0 until a batch has ended or every
  // worker is busy.
  std::chrono::nanoseconds TimeFor(int targets, TimePoint now) const;

 private:
  struct Batch {
    double targets = 0.0;  // 0: the worker is idle
    TimePoint begin;
  };

  // Returns the mean time per target of one worker over finished batches, seconds; 0 before the
  // first.
  double SecondsPerTarget() const { return targets_ > 0.0 ? seconds_ / targets_ : 0.0; }

  std::vector<Batch> at_work_;  // of each worker
  // Sums over finished batches, older ones weighted less.
  double targets_ = 0.0;
  double seconds_ = 0.0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_DRAIN_RATE_H_
