// Decides which targets are answered next, and which of them share a batch. It has neither a lock
// nor a clock: the batch scheduler calls it under its own lock and passes the time.
//
// Interactive and bulk calls wait in two lines. A line is in order of arrival, but smaller calls
// may overtake a large one: each target of the large call lets at most kOvertaking later targets
// pass. So a large call neither delays all others nor waits for ever. Calls of the same size are
// answered one after the other: sharing the workers evenly would make all of them late.
//
// A batch has targets of one line and of one model version. It takes the targets of the line's
// first call, then those of later calls for the same version, until it is full.
//
// Interactive batches go first and are never filled up with bulk targets. While both lines wait,
// bulk gets `bulk_share` of the targets: each interactive batch adds to a debt to the bulk line,
// and a bulk batch goes once the debt is a whole batch. Each line has its own limits, so neither
// can keep the other out of the queue.

#ifndef MANEUVER_SERVER_SERVING_TARGET_QUEUE_H_
#define MANEUVER_SERVER_SERVING_TARGET_QUEUE_H_

#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <vector>

#include "server/serving/prediction_call.h"

namespace maneuver::serving {

using CallPtr = std::shared_ptr<PredictionCall>;

struct QueueOptions {
  int max_batch = 8;                            // targets
  std::chrono::nanoseconds max_queue_delay{0};  // how long a batch that is not full may wait
  double bulk_share = 0.1;                      // in [0, 1): of the targets, while both lines wait
  // Of each priority:
  int max_queue = 4096;                          // targets
  int64_t max_queue_bytes = int64_t{256} << 20;  // of the calls that still have targets waiting
};

class TargetQueue {
 public:
  static constexpr int64_t kOvertaking = 8;

  explicit TargetQueue(const QueueOptions& options) : options_(options) {}

  // size counts waiting targets; bytes adds up the requests of their calls.
  int size() const { return size(Priority::kInteractive) + size(Priority::kBulk); }
  int size(Priority priority) const { return line(priority).targets; }
  int64_t bytes(Priority priority) const { return line(priority).bytes; }
  bool empty() const { return size() == 0; }
  // Returns how many targets are likely to be taken before a call of `targets` targets that arrives
  // now.
  int SizeBefore(Priority priority, size_t targets) const;
  // Returns whether there is room for the call. Call before Push.
  bool HasRoom(const PredictionCall& call) const;
  // Queues a call that arrives now.
  void Push(CallPtr call, TimePoint now);

  struct Item {
    CallPtr call;
    size_t target = 0;  // index into call->targets
  };
  // Removes and returns the targets that nobody waits for any more.
  std::vector<Item> TakeDead(TimePoint now);
  // Returns when the next batch is due: in the past if one is full or has waited long enough,
  // TimePoint::max() if the queue is empty.
  TimePoint NextBatchTime() const;
  // Removes and returns the next batch: 1 to max_batch targets of one priority and model version.
  // Empty only if the queue is.
  std::vector<Item> TakeBatch();
  // Removes and returns all targets.
  std::vector<Item> TakeAll();

 private:
  struct Line {
    std::multimap<int64_t, CallPtr> calls;  // by their place; each with at least one target left
    int64_t come = 0;                       // targets that ever joined this line
    // Returns the place of a call of `size` targets that arrives now. Smaller places go first.
    int64_t PlaceOf(size_t size) const;
    int targets = 0;
    int64_t bytes = 0;
  };

  Line& line(Priority priority) { return lines_[static_cast<size_t>(priority)]; }
  const Line& line(Priority priority) const { return lines_[static_cast<size_t>(priority)]; }
  Priority NextPriority() const;
  TimePoint NextBatchTime(const Line& line) const;
  std::vector<Item> TakeBatch(Line& line);
  std::vector<Item> TakeWhere(const std::function<bool(const PredictionCall&)>& wanted);

  const QueueOptions options_;
  std::array<Line, 2> lines_;
  double owed_to_bulk_ = 0.0;  // targets
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_TARGET_QUEUE_H_
