#include "server/jobs/job_watch.h"

#include <utility>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"
#include "server/jobs/job_state.h"

namespace maneuver::jobs {

struct JobNews::Subscription::Listener {
  explicit Listener(std::function<void()> call) : on_news(std::move(call)) {}

  Mutex mutex;  // held while on_news runs
  // Null once the subscription has ended.
  std::function<void()> on_news ABSL_GUARDED_BY(mutex);
};

JobNews::Subscription::Subscription(JobNews& news, std::string job,
                                    std::shared_ptr<Listener> listener)
    : news_(news), job_(std::move(job)), listener_(std::move(listener)) {}

JobNews::Subscription::~Subscription() {
  {
    const MutexLock lock(news_.mutex_);
    const auto [begin, end] = news_.listeners_.equal_range(job_);
    for (auto entry = begin; entry != end; ++entry) {
      if (entry->second != listener_) continue;
      news_.listeners_.erase(entry);
      break;
    }
  }
  const MutexLock lock(listener_->mutex);
  listener_->on_news = nullptr;
}

std::unique_ptr<JobNews::Subscription> JobNews::Subscribe(const std::string& job,
                                                          std::function<void()> on_news) {
  auto listener = std::make_shared<Subscription::Listener>(std::move(on_news));
  const MutexLock lock(mutex_);
  listeners_.emplace(job, listener);
  return std::unique_ptr<Subscription>(new Subscription(*this, job, std::move(listener)));
}

void JobNews::Publish(const std::string& job) {
  Listeners listeners;
  {
    const MutexLock lock(mutex_);
    const auto [begin, end] = listeners_.equal_range(job);
    for (auto entry = begin; entry != end; ++entry) listeners.push_back(entry->second);
  }
  Tell(listeners);
}

void JobNews::PublishAll() {
  Listeners listeners;
  {
    const MutexLock lock(mutex_);
    for (const auto& [job, listener] : listeners_) listeners.push_back(listener);
  }
  Tell(listeners);
}

void JobNews::Tell(const Listeners& listeners) {
  for (const auto& listener : listeners) {
    const MutexLock lock(listener->mutex);
    if (listener->on_news) listener->on_news();
  }
}

absl::StatusOr<std::vector<v1::Job>> JobEventReader::Next(int limit) {
  std::vector<v1::Job> news;
  if (at_end_) return news;
  // The job first: if it has ended, all of its events are there.
  auto job = store_.Get(job_);
  if (!job.ok()) return job.status();
  auto events = store_.ListProgress(job_, cursor_, limit);
  if (!events.ok()) return events.status();
  v1::Job running = *job;
  running.set_state(v1::JOB_STATE_RUNNING);
  running.clear_end_time();
  running.clear_error();
  running.clear_model_version();
  running.clear_evaluation();
  running.clear_cross_validation();
  running.clear_promotion_decision();
  running.clear_attempts();
  running.clear_cancel_requested();
  running.clear_last_lines();
  for (v1::JobProgress& event : *events) {
    // It was resumed in between: these come after its end.
    if (HasEnded(job->state()) && event.sequence() > job->progress().sequence()) break;
    cursor_ = event.sequence();
    *running.mutable_progress() = std::move(event);
    news.push_back(running);
  }
  if (HasEnded(job->state()) && news.size() < static_cast<size_t>(limit)) {
    at_end_ = true;
    news.push_back(*std::move(job));
  }
  return news;
}

}  // namespace maneuver::jobs
