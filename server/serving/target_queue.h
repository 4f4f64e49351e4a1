// Which targets are answered next, and with which others. No threads and no clock of its own: the
// batch scheduler holds a lock around it and passes the time.
//
// Calls stand in line. A batch takes targets from the first call, then from the others that ask the
// same model version, until it is full. A call that still has targets left then goes to the end of
// the line: a large call cannot make small ones wait for all of it.

#ifndef MANEUVER_SERVER_SERVING_TARGET_QUEUE_H_
#define MANEUVER_SERVER_SERVING_TARGET_QUEUE_H_

#include <chrono>
#include <deque>
#include <memory>
#include <vector>

#include "server/serving/prediction_call.h"

namespace maneuver::serving {

using CallPtr = std::shared_ptr<PredictionCall>;

struct QueueOptions {
  int max_batch = 8;                            // targets
  std::chrono::nanoseconds max_queue_delay{0};  // how long a batch that is not full may wait
  int max_queue = 4096;                         // targets
};

class TargetQueue {
 public:
  explicit TargetQueue(const QueueOptions& options) : options_(options) {}

  // Targets that wait.
  int size() const { return size_; }
  bool empty() const { return calls_.empty(); }
  // Whether a call of so many targets can be pushed.
  bool HasRoom(size_t targets) const;
  void Push(CallPtr call, TimePoint now);

  struct Item {
    CallPtr call;
    size_t target = 0;  // index into call->targets
  };
  // Takes out all that nobody waits for any more: it will reach no worker.
  std::vector<Item> TakeDead(TimePoint now);
  // When the next batch is to be taken: in the past if it is full or has waited long enough.
  // TimePoint::max() if there is nothing.
  TimePoint NextBatchTime() const;
  // The next batch: 1 to max_batch targets of one model version. Not empty unless the queue is.
  std::vector<Item> TakeBatch();
  // Takes out everything.
  std::vector<Item> TakeAll();

 private:
  std::vector<Item> TakeWhere(const std::function<bool(const PredictionCall&)>& wanted);

  const QueueOptions options_;
  std::deque<CallPtr> calls_;  // each with at least one target left
  int size_ = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_TARGET_QUEUE_H_
