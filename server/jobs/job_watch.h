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

// What one read of the store found out about a job.
struct JobRead {
  int64_t after_sequence = 0;
  int limit = 0;
  v1::Job job;  // as it was before its events were read: if it had ended, all of them are there
  std::vector<v1::JobProgress> events;  // after `after_sequence`, at most `limit`
};

// Tells listeners that a job has news. Each listener reads the news at its own pace, so a slow one
// never delays the job or the others. Listeners who are equally far share one read of the store.
// Safe to use from any thread.
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
  // Tells the listeners of a job that it has news.
  void Publish(const std::string& job);
  // Tells the listeners of every job.
  void PublishAll();

  // Returns the jobs that have listeners.
  std::vector<std::string> Watched();

  // Reads a job and its events from the store. A listener of the job gets what another one read, if
  // there was no news since. Errors: those of JobStore::Get and ListProgress.
  absl::StatusOr<std::shared_ptr<const JobRead>> Read(JobStore& store, const std::string& job,
                                                      int64_t after_sequence, int limit);

 private:
  using Listeners = std::vector<std::shared_ptr<Subscription::Listener>>;
  struct Topic;  // a job that has listeners
  static void Tell(const Listeners& listeners);

  Mutex mutex_;
  std::map<std::string, std::shared_ptr<Topic>> topics_ ABSL_GUARDED_BY(mutex_);  // by job
};

// Publishes what other servers do to jobs that somebody here watches. Not thread-safe.
class OthersNews {
 public:
  // Both must outlive this object.
  OthersNews(JobStore& store, JobNews& news) : store_(store), news_(news) {}

  // Looks whether a watched job has news that are in the store since the last call. Call it
  // regularly.
  void Publish();

 private:
  JobStore& store_;
  JobNews& news_;
  // How far the watched jobs were at the last call, by name.
  std::map<std::string, JobPosition> positions_;
};

// Reads a job's events after a cursor. Every reader with the same cursor gets the same sequence,
// whenever it starts: one RUNNING job for each event, then the ended job once. Not thread-safe.
class JobEventReader {
 public:
  //   news: shares what this reader reads with the job's listeners
  JobEventReader(JobStore& store, JobNews& news, std::string job, int64_t after_sequence)
      : store_(store), news_(news), job_(std::move(job)), cursor_(after_sequence) {}

  // Returns at most `limit` events that came since the last call; empty if there is nothing new, or
  // at the end. Errors: those of JobStore, such as NOT_FOUND for a job that was deleted.
  absl::StatusOr<std::vector<v1::Job>> Next(int limit);
  // Returns whether Next has returned the ended job.
  bool at_end() const { return at_end_; }

 private:
  JobStore& store_;
  JobNews& news_;
  const std::string job_;
  int64_t cursor_;
  bool at_end_ = false;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_WATCH_H_
