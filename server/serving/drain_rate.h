// How fast the workers empty the queue, as measured on the work of the last seconds.
//
// No threads and no clock of its own: the batch scheduler holds a lock around it and passes the
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

  // Worker 0 .. workers-1 takes a batch of `targets` > 0, and is done with it.
  void Begin(int worker, size_t targets, TimePoint now);
  void End(int worker, TimePoint now);

  // Whether each worker is at work, and how long they need for what is left of that, by the
  // measured speed: not negative.
  bool AllAtWork() const;
  std::chrono::nanoseconds TimeForWorkBegun(TimePoint now) const;

  // How long all workers together take for so many targets. A batch that takes longer than those
  // before it counts while it is still at work. 0 as long as nothing is known.
  std::chrono::nanoseconds TimeFor(int targets, TimePoint now) const;

 private:
  struct Batch {
    double targets = 0.0;  // 0: the worker is idle
    TimePoint begin;
  };

  // Of one worker, on the work that is done. 0 if nothing is known.
  double SecondsPerTarget() const { return targets_ > 0.0 ? seconds_ / targets_ : 0.0; }

  std::vector<Batch> at_work_;  // of each worker
  // Of the batches that are done, the older ones counting less.
  double targets_ = 0.0;
  double seconds_ = 0.0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_DRAIN_RATE_H_
