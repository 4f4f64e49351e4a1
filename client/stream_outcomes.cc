#include <algorithm>
#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/time/clock.h"
#include "client/client.h"
#include "client/connection.h"
#include "client/error_details.h"
#include "client/request_id.h"
#include "locks/mutex.h"

namespace maneuver::client {
namespace {

constexpr size_t kMostUnanswered = 4;

// Returns why the server postpones a report: it wants to have it again later. OK for other answers.
absl::Status PostponementIn(const v1::StreamOutcomesResponse& answer) {
  const absl::Status error = ToStatus(answer.error());
  return absl::IsResourceExhausted(error) && ErrorDetailsOf(error).retry_delay ? error
                                                                               : absl::OkStatus();
}

class GrpcOutcomeStream final : public OutcomeStream {
 public:
  GrpcOutcomeStream(Connection& connection, OnAnswer on_answer, const CallOptions& call)
      : connection_(connection),
        on_answer_(std::move(on_answer)),
        cancellation_(call.cancellation),
        answer_timeout_(call.timeout.value_or(connection.options.deadlines.management)) {}

  ~GrpcOutcomeStream() override {
    if (open_ == nullptr) return;
    open_->context.TryCancel();
    Close().IgnoreError();
  }

  absl::Status Send(v1::ReportOutcomesRequest report) override {
    if (finished_) return absl::FailedPreconditionError("the stream is finished; open another");
    if (!end_.ok()) return end_;
    unanswered_.push_back({WithRequestId(std::move(report))});
    if (open_ == nullptr) Open();
    if (absl::Status status = Write(unanswered_.back()); !status.ok()) {
      Deliver();
      return end_ = status;
    }
    return AwaitAnswers(kMostUnanswered - 1);
  }

  absl::Status Finish() override {
    if (finished_ || !end_.ok()) return end_;
    if (absl::Status status = AwaitAnswers(0); !status.ok()) return status;
    if (open_ != nullptr) {
      CancelAt(AnswerTime());
      open_->stream->WritesDone();
      // Each report was answered, however this ends.
      Close().IgnoreError();
    }
    finished_ = true;
    return absl::OkStatus();
  }

 private:
  using Stream = grpc::ClientReaderWriter<v1::StreamOutcomesRequest, v1::StreamOutcomesResponse>;

  // A report that was not delivered yet.
  struct Report {
    v1::ReportOutcomesRequest request;
    std::optional<v1::StreamOutcomesResponse> answer = {};  // waits for those of the reports before
  };

  // One stream to a server, the thread that reads it, and one that cancels it if the server does
  // not take a report in time.
  struct OpenCall {
    explicit OpenCall(Cancellation* cancellation)
        : registration(cancellation, [this] { context.TryCancel(); }) {}
    grpc::ClientContext context;
    const Cancellation::Registration registration;
    std::unique_ptr<Stream> stream;
    std::thread reader;
    std::thread watchdog;
  };

  void Open() {
    open_ = std::make_unique<OpenCall>(cancellation_);
    connection_.Introduce(open_->context);
    open_->stream = connection_.outcomes->StreamOutcomes(&open_->context);
    {
      const MutexLock lock(mutex_);
      broken_ = false;
      closed_ = false;
    }
    open_->reader = std::thread([this, &stream = *open_->stream] {
      v1::StreamOutcomesResponse answer;
      while (stream.Read(&answer)) {
        const MutexLock lock(mutex_);
        answers_.push_back(std::move(answer));
        changed_.NotifyAll();
      }
      const MutexLock lock(mutex_);
      broken_ = true;
      changed_.NotifyAll();
    });
    open_->watchdog = std::thread([this, &context = open_->context] {
      const MutexLock lock(mutex_);
      while (!closed_) {
        if (!write_by_) {
          write_changed_.Wait(mutex_);
        } else if (std::chrono::steady_clock::now() < *write_by_) {
          write_changed_.WaitUntil(mutex_, *write_by_);
        } else {
          write_by_.reset();
          context.TryCancel();
        }
      }
    });
  }

  std::chrono::steady_clock::time_point AnswerTime() const {
    constexpr absl::Duration kLongest = absl::Hours(10'000);  // beyond 292 years clocks overflow
    return std::chrono::steady_clock::now() +
           absl::ToChronoNanoseconds(std::min(answer_timeout_, kLongest));
  }

  // Lets the watchdog cancel the stream then, unless write_by_ is reset before.
  void CancelAt(std::chrono::steady_clock::time_point time) {
    const MutexLock lock(mutex_);
    write_by_ = time;
    write_changed_.NotifyAll();
  }

  // DEADLINE_EXCEEDED if the server did not take the report in time; the stream is closed then.
  // Other failures show when answers are awaited.
  absl::Status Write(Report& report) {
    v1::StreamOutcomesRequest message;
    *message.mutable_report() = report.request;
    sent_.push_back(&report);
    CancelAt(AnswerTime());
    const bool is_taken = open_->stream->Write(message);
    {
      const MutexLock lock(mutex_);
      const bool in_time = write_by_.has_value();
      write_by_.reset();
      if (is_taken || in_time) return absl::OkStatus();
    }
    Close().IgnoreError();
    return absl::DeadlineExceededError("the server did not take a report in time");
  }

  // Returns how a stream ended that is broken or cancelled, or whose writes are done.
  absl::Status Close() {
    open_->reader.join();
    {
      const MutexLock lock(mutex_);
      closed_ = true;
      write_changed_.NotifyAll();
    }
    open_->watchdog.join();
    Collect();
    sent_.clear();
    absl::Status status = ToRetriable(open_->stream->Finish(), cancellation_);
    open_ = nullptr;
    return status;
  }

  // Delivers answers until at most `most` reports have none.
  absl::Status AwaitAnswers(size_t most) {
    while (true) {
      Deliver();
      if (unanswered_.size() <= most) return absl::OkStatus();
      if (open_ != nullptr && sent_.empty()) {
        end_ = SendPostponed();
      } else {
        end_ = AwaitAnswer();
        if (end_.ok() && !HasAnswer()) end_ = Resume();
      }
      if (end_.ok()) continue;
      Deliver();  // what was answered before another report was not taken
      return end_;
    }
  }

  // Gives each answer that has arrived to its report.
  void Collect() {
    std::deque<v1::StreamOutcomesResponse> answers;
    {
      const MutexLock lock(mutex_);
      answers.swap(answers_);
    }
    for (v1::StreamOutcomesResponse& answer : answers) {
      if (sent_.empty()) return;
      Report& report = *sent_.front();
      sent_.pop_front();
      if (absl::Status why = PostponementIn(answer); !why.ok()) {
        postponement_ = std::move(why);
        continue;
      }
      postponed_since_.reset();
      answered_ = true;
      report.answer = std::move(answer);
    }
  }

  void Deliver() {
    Collect();
    while (!unanswered_.empty() && unanswered_.front().answer) {
      Report report = std::move(unanswered_.front());
      unanswered_.pop_front();
      if (!on_answer_) continue;
      if (report.answer->has_error()) {
        on_answer_(report.request, ToStatus(report.answer->error()));
      } else {
        on_answer_(report.request, std::move(*report.answer->mutable_response()));
      }
    }
  }

  // Sends all reports that have no answer.
  absl::Status WriteUnanswered() {
    for (Report& report : unanswered_) {
      if (report.answer) continue;
      if (absl::Status status = Write(report); !status.ok()) return status;
    }
    return absl::OkStatus();
  }

  // Sends again what the server has postponed, after the delay that it named. Returns why it was
  // postponed once that has gone on for too long.
  absl::Status SendPostponed() {
    const ClientOptions& options = connection_.options;
    const absl::Duration wait =
        std::max(ErrorDetailsOf(postponement_).retry_delay.value_or(absl::ZeroDuration()),
                 options.retry.initial_backoff);
    const absl::Time now = absl::Now();
    if (!postponed_since_) postponed_since_ = now;
    if (now + wait >= *postponed_since_ + options.upload_patience) return postponement_;
    if (options.on_retry) options.on_retry(postponement_, wait);
    if (cancellation_ == nullptr) {
      absl::SleepFor(wait);
    } else if (!cancellation_->Sleep(wait)) {
      return absl::CancelledError("the call was cancelled");
    }
    return WriteUnanswered();
  }

  // Waits until there is an answer or the stream is broken. DEADLINE_EXCEEDED if that takes too
  // long.
  absl::Status AwaitAnswer() {
    const auto give_up = AnswerTime();
    {
      const MutexLock lock(mutex_);
      while (answers_.empty() && !broken_) {
        if (!changed_.WaitUntil(mutex_, give_up)) break;
      }
      if (!answers_.empty() || broken_) return absl::OkStatus();
    }
    open_->context.TryCancel();
    Close().IgnoreError();
    return absl::DeadlineExceededError("the server did not answer a report in time");
  }

  bool HasAnswer() {
    const MutexLock lock(mutex_);
    return !answers_.empty();
  }

  // Closes a broken stream, and opens others until one has an answer.
  absl::Status Resume() {
    const ClientOptions& options = connection_.options;
    RetryPolicy policy = options.retry;
    absl::Time give_up = absl::InfiniteFuture();
    if (answered_) {
      policy.max_attempts = 1'000'000;
      give_up = absl::Now() + options.upload_patience;
    }
    return RetryUnavailable(policy, give_up, cancellation_, options.on_retry, [this] {
      if (open_ == nullptr) {
        Open();
        if (absl::Status status = WriteUnanswered(); !status.ok()) return status;
        if (absl::Status status = AwaitAnswer(); !status.ok()) return status;
        if (HasAnswer()) return absl::OkStatus();
      }
      absl::Status status = Close();
      return status.ok() ? absl::UnavailableError("the server ended the stream") : status;
    });
  }

  Connection& connection_;
  const OnAnswer on_answer_;
  Cancellation* const cancellation_;
  const absl::Duration answer_timeout_;

  // Used by the caller's thread alone.
  std::unique_ptr<OpenCall> open_;
  std::deque<Report> unanswered_;  // in the order in which the caller sent them
  std::deque<Report*> sent_;       // of them, on the open stream, in the order of their answers
  absl::Status postponement_;      // the last one
  std::optional<absl::Time> postponed_since_;  // nothing was answered since then
  bool answered_ = false;                      // at least one report
  absl::Status end_;                           // not OK: the stream has failed
  bool finished_ = false;

  Mutex mutex_;
  CondVar changed_;
  std::deque<v1::StreamOutcomesResponse> answers_ ABSL_GUARDED_BY(mutex_);  // not delivered yet
  bool broken_ ABSL_GUARDED_BY(mutex_) = false;
  CondVar write_changed_;
  // When the watchdog cancels the stream; nothing while neither a report is being written nor the
  // stream's end awaited.
  std::optional<std::chrono::steady_clock::time_point> write_by_ ABSL_GUARDED_BY(mutex_);
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;  // the watchdog is to end
};

}  // namespace

std::unique_ptr<OutcomeStream> Client::StreamOutcomes(OutcomeStream::OnAnswer on_answer,
                                                      const CallOptions& call) {
  return std::make_unique<GrpcOutcomeStream>(*connection_, std::move(on_answer), call);
}

}  // namespace maneuver::client
