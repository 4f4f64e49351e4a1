#include "server/rpc/training_watch.h"

#include <utility>

#include "server/rpc/blocking_call.h"
#include "server/security/resource_name.h"

namespace maneuver::rpc {
namespace {

// Events that are read from the store at once.
constexpr int kBatch = 64;

absl::Status Check(const v1::WatchJobRequest& request) {
  if (const auto id = security::ParseJobName(request.name(), "name"); !id.ok()) return id.status();
  if (request.after_sequence() < 0) {
    return errors::InvalidField("after_sequence", "expected 0 or more");
  }
  return absl::OkStatus();
}

}  // namespace

JobWatchCall::JobWatchCall(jobs::Supervisor& jobs, jobs::WorkerPool& pool,
                           const v1::WatchJobRequest& request)
    : jobs_(jobs), pool_(pool) {
  if (const absl::Status status = Check(request); !status.ok()) {
    End(status);
    return;
  }
  reader_ = std::make_unique<jobs::JobEventReader>(jobs.store(), request.name(),
                                                   request.after_sequence());
  // Before the first look at the store: nothing is missed in between.
  subscription_ = jobs.news().Subscribe(request.name(), [this] { OnNews(); });
  // The client knows that it is heard, even if there is nothing to tell for long.
  StartSendInitialMetadata();
  if (!pool_.Post([this] { ReadNext(); })) End(Busy());
}

void JobWatchCall::OnNews() {
  {
    const std::lock_guard lock(mutex_);
    has_news_ = true;
    if (phase_ != Phase::kWaiting) return;
    phase_ = Phase::kWorking;
  }
  ReadSoon();
}

void JobWatchCall::ReadSoon() {
  pool_.Continue([this] { ReadNext(); });
}

void JobWatchCall::ReadNext() {
  for (;;) {
    {
      const std::lock_guard lock(mutex_);
      has_news_ = false;
    }
    const bool is_stopped = jobs_.IsStopped();
    auto news = reader_->Next(kBatch);
    if (!news.ok()) {
      End(absl::IsNotFound(news.status()) ? errors::WithReason(news.status(), "JOB_NOT_FOUND")
                                          : news.status());
      return;
    }
    if (!news->empty()) {
      unsent_.assign(std::make_move_iterator(news->begin()), std::make_move_iterator(news->end()));
      WriteNext();
      return;
    }
    if (is_stopped) {
      End(errors::WithReason(
          absl::UnavailableError("the server is stopping; watch again once it is back"),
          "SERVER_STOPS"));
      return;
    }
    const std::lock_guard lock(mutex_);
    if (is_cancelled_) break;
    if (has_news_) continue;
    phase_ = Phase::kWaiting;
    return;
  }
  End(absl::CancelledError("the watch was cancelled"));
}

void JobWatchCall::WriteNext() {
  *message_.mutable_job() = std::move(unsent_.front());
  unsent_.pop_front();
  StartWrite(&message_);
}

void JobWatchCall::OnWriteDone(bool ok) {
  if (!ok) {
    End(absl::CancelledError("the watch was cancelled"));
  } else if (!unsent_.empty()) {
    WriteNext();
  } else if (reader_->at_end()) {
    End(absl::OkStatus());
  } else {
    ReadSoon();
  }
}

void JobWatchCall::OnCancel() {
  {
    const std::lock_guard lock(mutex_);
    is_cancelled_ = true;
    if (phase_ != Phase::kWaiting) return;  // who works will see it
    phase_ = Phase::kWorking;
  }
  End(absl::CancelledError("the watch was cancelled"));
}

void JobWatchCall::End(const absl::Status& status) {
  {
    const std::lock_guard lock(mutex_);
    phase_ = Phase::kFinished;
  }
  Finish(ToGrpcStatus(status));
}

}  // namespace maneuver::rpc
