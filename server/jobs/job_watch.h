// Following a job: who is told that there is news, and what the news is.

#ifndef MANEUVER_SERVER_JOBS_JOB_WATCH_H_
#define MANEUVER_SERVER_JOBS_JOB_WATCH_H_

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "locks/mutex.h"
#include "server/jobs/job_store.h"

namespace maneuver::jobs {

// Tells listeners that a job has news; what it is they read from the store, each at its own pace,
// so that a slow one never holds up the job or the others. Safe to use from any thread.
class JobNews {
 public:
  // Ends with its destruction, which waits for a call that is under way.
  class Subscription {
   public:
    ~Subscription();
    Subscription(const Subscription&) = delete;
    Subscription& operator=(const Subscription&) = delete;

   private:
    friend class JobNews;
    struct Listener;
    Subscription(JobNews& news, std::string job, std::shared_ptr<Listener> listener);
    JobNews& news_;
    const std::string job_;
    const std::shared_ptr<Listener> listener_;
  };

  // `on_news` is called from any thread and must return at once: it may not destroy its
  // subscription. The subscription must not outlive this.
  [[nodiscard]] std::unique_ptr<Subscription> Subscribe(const std::string& job,
                                                        std::function<void()> on_news);
  void Publish(const std::string& job);
  // To the listeners of every job.
  void PublishAll();

 private:
  using Listeners = std::vector<std::shared_ptr<Subscription::Listener>>;
  static void Tell(const Listeners& listeners);

  Mutex mutex_;
  std::multimap<std::string, std::shared_ptr<Subscription::Listener>> listeners_
      ABSL_GUARDED_BY(mutex_);
};

// Reads a job's events from a cursor on. Every reader with the same cursor gets the same sequence,
// whenever it comes: one RUNNING job for each event, then once the job as it ended. Not
// thread-safe.
class JobEventReader {
 public:
  JobEventReader(JobStore& store, std::string job, int64_t after_sequence)
      : store_(store), job_(std::move(job)), cursor_(after_sequence) {}

  // What has come since the last call, at most so many; none: nothing new yet, or at the end.
  absl::StatusOr<std::vector<v1::Job>> Next(int limit);
  // Whether Next returned the ended job.
  bool at_end() const { return at_end_; }

 private:
  JobStore& store_;
  const std::string job_;
  int64_t cursor_;
  bool at_end_ = false;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_WATCH_H_
