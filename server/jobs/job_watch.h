// Follows jobs: tells listeners that a job has news, and reads the news.

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

// Tells listeners that a job has news. Each listener reads the news from the store at its own pace,
// so a slow one never delays the job or the others. Safe to use from any thread.
class JobNews {
 public:
  // A subscription lasts until it is destroyed. Its destructor waits for a call in progress.
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

  // Calls `on_news` whenever `job` has news, from any thread. `on_news` must return at once and
  // must not destroy its subscription. The subscription must not outlive this object.
  [[nodiscard]] std::unique_ptr<Subscription> Subscribe(const std::string& job,
                                                        std::function<void()> on_news);
  void Publish(const std::string& job);
  // Tells the listeners of every job.
  void PublishAll();

 private:
  using Listeners = std::vector<std::shared_ptr<Subscription::Listener>>;
  static void Tell(const Listeners& listeners);

  Mutex mutex_;
  std::multimap<std::string, std::shared_ptr<Subscription::Listener>> listeners_
      ABSL_GUARDED_BY(mutex_);
};

// Reads a job's events after a cursor. Every reader with the same cursor gets the same sequence,
// whenever it starts: one RUNNING job for each event, then the ended job once. Not thread-safe.
class JobEventReader {
 public:
  JobEventReader(JobStore& store, std::string job, int64_t after_sequence)
      : store_(store), job_(std::move(job)), cursor_(after_sequence) {}

  // Returns at most `limit` events that came since the last call; empty if there is nothing new, or
  // at the end. Errors: those of JobStore, such as NOT_FOUND for a job that was deleted.
  absl::StatusOr<std::vector<v1::Job>> Next(int limit);
  // Returns whether Next has returned the ended job.
  bool at_end() const { return at_end_; }

 private:
  JobStore& store_;
  const std::string job_;
  int64_t cursor_;
  bool at_end_ = false;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_WATCH_H_
