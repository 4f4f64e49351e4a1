// Which targets are answered next, and with which others. No threads and no clock of its own: the
// batch scheduler holds a lock around it and passes the time.
//
// Calls stand in two lines, interactive and bulk, in the order in which they came, but that a large
// call lets smaller ones overtake it: up to kOvertaking targets for each of its own, so that it
// neither makes them wait for all of it nor waits for ever itself. Calls of one size are done one
// after the other: by halves, all of them would be late. A batch is of one line and of one model
// version: it takes targets from the line's first call, then from the others that ask the same
// version, until it is full.
//
// Interactive batches go first, and wait for no bulk target to fill them. While both lines wait,
// bulk still gets `bulk_share` of the targets: each interactive batch adds to what bulk is owed,
// and once that is a batch, a bulk batch goes. Each line has its own bounds: neither can keep the
// other out of the queue.

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
  // Of each priority:
  int max_queue = 4096;                          // targets
  int64_t max_queue_bytes = int64_t{256} << 20;  // of the calls that still have targets waiting
  double bulk_share = 0.1;                       // in [0, 1): of the targets, while both lines wait
};

class TargetQueue {
 public:
  static constexpr int64_t kOvertaking = 8;

  explicit TargetQueue(const QueueOptions& options) : options_(options) {}

  // Waiting targets, and bytes of their calls.
  int size() const { return size(Priority::kInteractive) + size(Priority::kBulk); }
  int size(Priority priority) const { return line(priority).targets; }
  int64_t bytes(Priority priority) const { return line(priority).bytes; }
  bool empty() const { return size() == 0; }
  // Returns how many targets are likely to be taken before a call of `targets` targets that arrives
  // now.
  int SizeBefore(Priority priority, size_t targets) const;
  // Returns whether there is room for the call. Call before Push.
  bool HasRoom(const PredictionCall& call) const;
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
    int64_t come = 0;                       // targets, since the beginning
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
