#include "server/rpc/training_watch.h"

#include <utility>

#include "server/rpc/blocking_call.h"
#include "server/rpc/guarded_service.h"
#include "server/security/resource_name.h"

namespace maneuver::rpc {
namespace {

// Events that are read from the store at once.
constexpr int kBatch = 64;
constexpr char kWatchMethod[] = "/maneuver.v1.TrainingService/WatchJob";

absl::Status Check(const v1::WatchJobRequest& request) {
  if (const auto id = security::ParseJobName(request.name(), "name"); !id.ok()) return id.status();
  if (request.after_sequence() < 0) {
    return errors::InvalidField("after_sequence", "expected 0 or more");
  }
  return absl::OkStatus();
}

}  // namespace

JobWatchCall::JobWatchCall(jobs::Supervisor& jobs, const BlockingWork& blocking,
                           security::AccessControl& access, grpc::CallbackServerContext* rpc,
                           const v1::WatchJobRequest& request)
    : jobs_(jobs), blocking_(blocking), rpc_(rpc) {
  absl::Status status = Check(request);
  if (status.ok()) status = blocking_.send_memory.CheckRoom();
  if (!status.ok()) {
    End(status);
    return;
  }
  reader_ = std::make_unique<jobs::JobEventReader>(jobs.store(), jobs.news(), request.name(),
                                                   request.after_sequence());
  // Before the first look at the store: nothing is missed in between.
  subscription_ = jobs.news().Subscribe(request.name(), [this] { OnNews(); });
  admission_ = access.Watch(kWatchMethod, CredentialsOf(*rpc),
                            [this](const absl::Status& refusal) { OnRefused(refusal); });
  // The client knows that it is heard, even if there is nothing to tell for long.
  StartSendInitialMetadata();
  if (!blocking_.pool.Post([this] { ReadNext(); })) End(Busy());
}

void JobWatchCall::OnNews() {
  {
    const MutexLock lock(mutex_);
    has_news_ = true;
    if (phase_ != Phase::kWaiting) return;
    phase_ = Phase::kWorking;
  }
  ReadSoon();
}

void JobWatchCall::OnRefused(const absl::Status& refusal) {
  bool again = false;
  {
    const MutexLock lock(mutex_);
    again = !refusal_.ok();
    refusal_ = refusal;
    if (phase_ == Phase::kWaiting) {
      phase_ = Phase::kWorking;
      again = false;
    } else if (!again || phase_ == Phase::kFinished) {
      return;  // who works will see it
    }
  }
  if (again) {
    rpc_->TryCancel();
  } else {
    End(refusal);
  }
}

void JobWatchCall::ReadSoon() {
  blocking_.pool.Continue([this] { ReadNext(); });
}

void JobWatchCall::ReadNext() {
  share_ = {};  // all was taken
  for (;;) {
    absl::Status refusal;
    {
      const MutexLock lock(mutex_);
      has_news_ = false;
      refusal = refusal_;
    }
    if (!refusal.ok()) return End(refusal);
    const bool is_stopped = jobs_.IsStopped();
    auto news = reader_->Next(kBatch);
    if (!news.ok()) {
      End(absl::IsNotFound(news.status()) ? errors::WithReason(news.status(), "JOB_NOT_FOUND")
                                          : news.status());
      return;
    }
    if (!news->empty()) {
      unsent_.assign(std::make_move_iterator(news->begin()), std::make_move_iterator(news->end()));
      int64_t bytes = 0;
      for (const v1::Job& job : unsent_) bytes += static_cast<int64_t>(job.ByteSizeLong());
      share_ = blocking_.send_memory.Take(bytes);
      WriteNext();
      return;
    }
    if (is_stopped) {
      End(errors::WithReason(
          absl::UnavailableError("the server is stopping; watch again once it is back"),
          "SERVER_STOPS"));
      return;
    }
    const MutexLock lock(mutex_);
    if (is_cancelled_) break;
    if (has_news_ || !refusal_.ok()) continue;
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
    const MutexLock lock(mutex_);
    is_cancelled_ = true;
    if (phase_ != Phase::kWaiting) return;  // who works will see it
    phase_ = Phase::kWorking;
  }
  End(absl::CancelledError("the watch was cancelled"));
}

void JobWatchCall::End(const absl::Status& status) {
  {
    const MutexLock lock(mutex_);
    phase_ = Phase::kFinished;
  }
  Finish(ToGrpcStatus(status));
}

}  // namespace maneuver::rpc
