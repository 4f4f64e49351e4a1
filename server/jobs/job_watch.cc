#include "server/jobs/job_watch.h"

#include <atomic>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"
#include "server/jobs/job_state.h"

namespace maneuver::jobs {

namespace {

// Returns whether a read says what another one would, if nothing changed: it begins no later, and
// has all that follows.
bool Covers(const JobRead& read, int64_t after_sequence, int limit) {
  if (read.limit != limit) return false;
  return read.after_sequence == after_sequence ||
         (read.after_sequence < after_sequence && read.events.size() < static_cast<size_t>(limit));
}

}  // namespace

struct JobNews::Subscription::Listener {
  explicit Listener(std::function<void()> call) : on_news(std::move(call)) {}

  Mutex mutex;  // held while on_news runs
  // Null once the subscription has ended.
  std::function<void()> on_news ABSL_GUARDED_BY(mutex);
};

struct JobNews::Topic {
  Listeners listeners;           // guarded by the mutex of JobNews
  std::atomic<int64_t> news{0};  // how often there was some

  Mutex reading;  // held while one listener reads: the others wait for what it finds
  std::shared_ptr<const JobRead> last ABSL_GUARDED_BY(reading);
  int64_t news_before_last ABSL_GUARDED_BY(reading) = 0;  // `news` as that read began
};

JobNews::Subscription::Subscription(JobNews& news, std::string job,
                                    std::shared_ptr<Listener> listener)
    : news_(news), job_(std::move(job)), listener_(std::move(listener)) {}

JobNews::Subscription::~Subscription() {
  {
    const MutexLock lock(news_.mutex_);
    const auto topic = news_.topics_.find(job_);
    std::erase(topic->second->listeners, listener_);
    if (topic->second->listeners.empty()) news_.topics_.erase(topic);
  }
  const MutexLock lock(listener_->mutex);
  listener_->on_news = nullptr;
}

std::unique_ptr<JobNews::Subscription> JobNews::Subscribe(const std::string& job,
                                                          std::function<void()> on_news) {
  auto listener = std::make_shared<Subscription::Listener>(std::move(on_news));
  const MutexLock lock(mutex_);
  std::shared_ptr<Topic>& topic = topics_[job];
  if (topic == nullptr) topic = std::make_shared<Topic>();
  topic->listeners.push_back(listener);
  return std::unique_ptr<Subscription>(new Subscription(*this, job, std::move(listener)));
}

void JobNews::Publish(const std::string& job) {
  Listeners listeners;
  {
    const MutexLock lock(mutex_);
    const auto topic = topics_.find(job);
    if (topic == topics_.end()) return;
    ++topic->second->news;
    listeners = topic->second->listeners;
  }
  Tell(listeners);
}

void JobNews::PublishAll() {
  Listeners listeners;
  {
    const MutexLock lock(mutex_);
    for (const auto& [job, topic] : topics_) {
      ++topic->news;
      listeners.insert(listeners.end(), topic->listeners.begin(), topic->listeners.end());
    }
  }
  Tell(listeners);
}

void JobNews::Tell(const Listeners& listeners) {
  for (const auto& listener : listeners) {
    const MutexLock lock(listener->mutex);
    if (listener->on_news) listener->on_news();
  }
}

std::vector<std::string> JobNews::Watched() {
  const MutexLock lock(mutex_);
  std::vector<std::string> jobs;
  for (const auto& [job, topic] : topics_) jobs.push_back(job);
  return jobs;
}

absl::StatusOr<std::shared_ptr<const JobRead>> JobNews::Read(JobStore& store,
                                                             const std::string& job,
                                                             int64_t after_sequence, int limit) {
  std::shared_ptr<Topic> topic;
  {
    const MutexLock lock(mutex_);
    const auto found = topics_.find(job);
    topic = found == topics_.end() ? std::make_shared<Topic>() : found->second;
  }
  const MutexLock lock(topic->reading);
  // Before the read: what comes while it reads is news after it.
  const int64_t news = topic->news;
  if (topic->last != nullptr && topic->news_before_last == news &&
      Covers(*topic->last, after_sequence, limit)) {
    return topic->last;
  }
  auto stored = store.Get(job);
  if (!stored.ok()) return stored.status();
  auto events = store.ListProgress(job, after_sequence, limit);
  if (!events.ok()) return events.status();
  topic->last = std::make_shared<const JobRead>(
      JobRead{after_sequence, limit, *std::move(stored), *std::move(events)});
  topic->news_before_last = news;
  return topic->last;
}

void OthersNews::Publish() {
  const std::vector<std::string> watched = news_.Watched();
  std::map<std::string, JobPosition> positions;
  if (!watched.empty()) {
    const auto listed = store_.ListPositions(watched);
    if (!listed.ok()) return;  // what came meanwhile is news the next time
    for (const JobPosition& position : *listed) positions[position.job] = position;
  }
  for (const std::string& job : watched) {
    const auto before = positions_.find(job);
    const auto now = positions.find(job);  // none: the job was deleted
    if (before == positions_.end() || now == positions.end() || before->second != now->second) {
      news_.Publish(job);
    }
  }
  positions_ = std::move(positions);
}

absl::StatusOr<std::vector<v1::Job>> JobEventReader::Next(int limit) {
  std::vector<v1::Job> news;
  if (at_end_) return news;
  const auto read = news_.Read(store_, job_, cursor_, limit);
  if (!read.ok()) return read.status();
  const v1::Job& job = (*read)->job;
  v1::Job running = job;
  running.set_state(v1::JOB_STATE_RUNNING);
  running.clear_end_time();
  running.clear_error();
  running.clear_model_version();
  running.clear_evaluation();
  running.clear_cross_validation();
  running.clear_tagged();
  running.clear_promotion_decision();
  running.clear_attempts();
  running.clear_cancel_requested();
  running.clear_last_lines();
  for (const v1::JobProgress& event : (*read)->events) {
    if (event.sequence() <= cursor_) continue;
    // It was resumed in between: these come after its end.
    if (HasEnded(job.state()) && event.sequence() > job.progress().sequence()) break;
    cursor_ = event.sequence();
    *running.mutable_progress() = event;
    news.push_back(running);
  }
  if (HasEnded(job.state()) && news.size() < static_cast<size_t>(limit)) {
    at_end_ = true;
    news.push_back(job);
  }
  return news;
}

}  // namespace maneuver::jobs
