// Answers prediction calls: gathers their targets into batches, and runs each batch through the
// stages raster, vectors, encode and describe on one of a few worker threads.
//
// Work that nobody waits for is dropped on entry, on leaving the queue and before each stage, so it
// never reaches the networks. Interactive work goes before bulk work (target_queue.h).

#ifndef MANEUVER_SERVER_SERVING_BATCH_SCHEDULER_H_
#define MANEUVER_SERVER_SERVING_BATCH_SCHEDULER_H_

#include <array>
#include <atomic>
#include <functional>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "locks/mutex.h"
#include "model/machine/thread_priority.h"
#include "server/monitoring/metrics.h"
#include "server/security/rate_limiter.h"
#include "server/serving/drain_rate.h"
#include "server/serving/prediction_call.h"
#include "server/serving/scheduler_metrics.h"
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
  // Answers waiting calls with UNAVAILABLE, and finishes those in progress.
  ~BatchScheduler();
  BatchScheduler(const BatchScheduler&) = delete;
  BatchScheduler& operator=(const BatchScheduler&) = delete;

  // Queues a call. After OK, call->done will be called once; after an error it will not:
  //   CANCELLED, DEADLINE_EXCEEDED: nobody waits for the call any more.
  //   UNAVAILABLE: the scheduler is being destroyed.
  //   RESOURCE_EXHAUSTED, reason QUEUE_FULL: the retry delay is the time that the workers need, at
  //     their measured speed, for the queue.
  //   RESOURCE_EXHAUSTED, reason DEADLINE_TOO_CLOSE: the call would be late; the retry delay says
  //     by how much.
  //   RESOURCE_EXHAUSTED, reason TOO_MANY_TARGETS or REQUEST_TOO_LARGE: the call alone exceeds the
  //     queue and must be split.
  absl::Status Submit(CallPtr call);

  // Returns the DEADLINE_TOO_CLOSE error of Submit if a call of `targets` targets is not expected
  // to be answered by `deadline`. Call it before the request is parsed: an early refusal leaves
  // time for calls that can still be answered. A call that finds an idle worker is always admitted.
  absl::Status CheckWait(Priority priority, size_t targets, TimePoint deadline);

  // Returns whether targets wait for a worker. Takes no lock, so frequent calls delay nobody.
  bool HasWaiting() const { return waiting_.load(std::memory_order_relaxed) > 0; }

 private:
  // A target on its way through the stages.
  struct Row {
    TargetQueue::Item item;
    inference::SceneInputsView scene = {};
  };

  void Work(int worker) ABSL_LOCKS_EXCLUDED(mutex_);
  void RunBatch(std::vector<TargetQueue::Item> items);
  // Reads the scenes of the rows that somebody waits for: all rasters, then all vectors, whichever
  // the model reads. Returns the time when it is done.
  TimePoint ReadScenes(Engine& engine, std::vector<Row>& rows, TimePoint start);
  // Returns OK if the call fits into an empty queue.
  absl::Status CheckSize(const PredictionCall& call) const;
  // Completes the target's answer from the encoding of its scene. Returns INTERNAL if the engine
  // fails or the answer is invalid (answer_check.h).
  absl::Status Describe(const TargetQueue::Item& item, inference::SceneEncoding&& encoding,
                        ServedModel::Lease& engine, TargetAnswer* answer);
  // Counts an answer that was withheld, and logs it with the digest of the scenario.
  void NoteWithheld(const PredictionCall& call, const Target& target, const absl::Status& status);
  // Gives each row the INTERNAL error of an engine that failed.
  void Withhold(const std::vector<Row>& rows, const absl::Status& status,
                ServedModel::Lease& engine);
  // Records a target's answer or error. The last answer of a scenario combines its targets, if the
  // call asks for that. The last answer of a call answers the call.
  //   engine: nullptr where the whole call fails
  void Answer(const TargetQueue::Item& item, TargetAnswer answer, ServedModel::Lease* engine);
  // Counts the targets of a set that have an answer, once all of them are through.
  void CountAnswered(const PredictionCall& call, TargetRange range);
  // Combines the targets of a set (joint_answer.h). If the engine fails, each has its error.
  void Combine(PredictionCall& call, size_t set, ServedModel::Lease& engine);
  void CountDead(const absl::Status& status, Passed passed, size_t targets);
  // Gives each item the error of its call.
  void Drop(const std::vector<TargetQueue::Item>& items, TimePoint now, Passed passed);
  // Removes the rows that nobody waits for any more. Returns the time.
  TimePoint DropDead(std::vector<Row>& rows, Passed passed);
  void ShowQueueLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::chrono::nanoseconds RetryDelayLocked(Priority priority, TimePoint now) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Checks whether a call that arrives now with this many targets can meet its deadline.
  absl::Status CheckWaitLocked(Priority priority, size_t targets, TimePoint deadline,
                               TimePoint now) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const SchedulerOptions options_;
  SchedulerMetrics metrics_;
  security::RateLimiter fault_lines_;  // limits the log lines about faults

  Mutex mutex_;
  CondVar wake_;
  TargetQueue queue_ ABSL_GUARDED_BY(mutex_);
  DrainRate drain_rate_ ABSL_GUARDED_BY(mutex_);
  // Index: Priority. The time since which calls of that priority have been waiting without a break.
  std::array<TimePoint, 2> waiting_since_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;

  std::atomic<int> waiting_ = 0;  // targets in the queue, written under mutex_

  // The threads that submit calls. While there is a backlog they yield to the workers: what they
  // submit would only wait.
  machine::PassingThreads submitters_;

  std::vector<std::thread> workers_;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_BATCH_SCHEDULER_H_
