// Answers prediction calls: gathers their targets into batches, and runs each batch through the
// stages raster, encode and describe on one of a few worker threads.
//
// Work that nobody waits for is dropped on entry, on leaving the queue and before each stage, so it
// never reaches the networks.

#ifndef MANEUVER_SERVER_SERVING_BATCH_SCHEDULER_H_
#define MANEUVER_SERVER_SERVING_BATCH_SCHEDULER_H_

#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "absl/status/status.h"
#include "server/monitoring/metrics.h"
#include "server/serving/prediction_call.h"
#include "server/serving/target_queue.h"

namespace maneuver::serving {

struct SchedulerOptions {
  int workers = 1;
  QueueOptions queue;
  // The time; replaced in tests.
  std::function<TimePoint()> now = [] { return std::chrono::steady_clock::now(); };
};

// Safe to use from any thread.
class BatchScheduler {
 public:
  BatchScheduler(const SchedulerOptions& options, monitoring::MetricRegistry& metrics);
  // Answers what still waits with UNAVAILABLE, and what is being worked on properly.
  ~BatchScheduler();
  BatchScheduler(const BatchScheduler&) = delete;
  BatchScheduler& operator=(const BatchScheduler&) = delete;

  // OK: call->done will be called, once. Otherwise it will not:
  //   CANCELLED, DEADLINE_EXCEEDED   nobody waits for it;
  //   RESOURCE_EXHAUSTED             the queue is full, with a retry delay; or the call alone has
  //                                  more targets than fit, and must be split.
  absl::Status Submit(CallPtr call);

 private:
  // A target on its way through the stages.
  struct Row {
    TargetQueue::Item item;
    inference::SceneInput scene = {};
  };

  struct Metrics {
    explicit Metrics(monitoring::MetricRegistry& registry);
    monitoring::Histogram& batch_size;
    monitoring::Histogram& queue_time;
    monitoring::Histogram& raster_time;
    monitoring::Histogram& encode_time;
    monitoring::Histogram& describe_time;
    monitoring::Gauge& queue_depth;
    monitoring::Counter& answered;
    monitoring::Counter& expired;
    monitoring::Counter& cancelled;
    monitoring::Counter& refused;
  };

  void Work();
  void RunBatch(std::vector<TargetQueue::Item> items);
  void CountDead(const absl::Status& status);
  // Gives each item the error of its call.
  void Drop(const std::vector<TargetQueue::Item>& items, TimePoint now);
  // Takes out the targets that nobody waits for. Returns the time.
  TimePoint DropDead(std::vector<Row>& rows);
  std::chrono::nanoseconds RetryDelayLocked() const;

  const SchedulerOptions options_;
  Metrics metrics_;

  std::mutex mutex_;  // guards what follows
  std::condition_variable wake_;
  TargetQueue queue_;
  double seconds_per_target_ = 0.005;  // of one worker; smoothed
  bool stopping_ = false;

  std::vector<std::thread> workers_;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_BATCH_SCHEDULER_H_
