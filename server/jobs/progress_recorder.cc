#include "server/jobs/progress_recorder.h"

#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <utility>

#include "server/errors/error_details.h"
#include "server/jobs/job_time.h"
#include "server/monitoring/logging.h"

namespace maneuver::jobs {
namespace {

constexpr absl::Duration kShortest = absl::Milliseconds(200);

}  // namespace

ProgressRecorder::ProgressRecorder(JobStore& store, JobNews& news, const v1::Job& job,
                                   JobLease lease, std::function<absl::Time()> now,
                                   std::function<void(const v1::JobProgress&)> show)
    : store_(store),
      news_(news),
      lease_(std::move(lease)),
      attempt_(job.attempts().started()),
      now_(std::move(now)),
      show_(std::move(show)),
      last_sequence_(job.progress().sequence()),
      last_fraction_(job.progress().fraction()) {}

void ProgressRecorder::SetPart(double begin, double end) {
  part_begin_ = begin;
  part_end_ = end;
  runs_after_ = 0;
}

void ProgressRecorder::SetRest(int runs) {
  // The last report of a run may have come before its end.
  const double begin = part_end_ < 1.0 && runs_after_ > 0 ? part_end_ : last_fraction_;
  SetPart(begin, begin + (1.0 - begin) / runs);
  runs_after_ = runs - 1;
  run_begun_at_ = now_();
}

void ProgressRecorder::Record(const std::string& line) {
  v1::JobProgress progress;
  google::protobuf::util::JsonParseOptions options;
  options.ignore_unknown_fields = true;
  if (!google::protobuf::util::JsonStringToMessage(line, &progress, options).ok()) {
    monitoring::Log(monitoring::LogLevel::kWarning, "trainer reported no progress message",
                    {{"job", lease_.job}});
    return;
  }
  progress.set_fraction(part_begin_ + (part_end_ - part_begin_) * progress.fraction());
  last_fraction_ = progress.fraction();
  if (progress.has_time_left()) {
    absl::Duration left = ToDuration(progress.time_left());
    if (runs_after_ > 0) left += runs_after_ * (now_() - run_begun_at_ + left);
    *progress.mutable_time_left() = ToProto(left);
    ends_at_ = now_() + left;
  } else if (ends_at_) {
    // The next trainer does not know yet how long it takes.
    *progress.mutable_time_left() = ToProto(std::max(absl::ZeroDuration(), *ends_at_ - now_()));
  }
  if (!progress.has_time()) *progress.mutable_time() = ToTimestamp(now_());
  if (progress.has_epoch_report() || progress.phase() != last_phase_ || IsDue()) {
    waiting_.reset();
    Store(std::move(progress));
  } else {
    waiting_ = std::move(progress);
  }
}

void ProgressRecorder::Tick() {
  if (waiting_ && IsDue()) Flush();
}

bool ProgressRecorder::IsDue() const {
  const absl::Duration passed = now_() - last_time_;
  return passed >= kShortest || passed < absl::ZeroDuration();  // the clock was set back
}

void ProgressRecorder::Flush() {
  if (!waiting_) return;
  Store(*std::exchange(waiting_, std::nullopt));
}

void ProgressRecorder::Store(v1::JobProgress progress) {
  progress.set_sequence(last_sequence_ + 1);
  progress.set_attempt(attempt_);
  last_time_ = now_();
  last_phase_ = progress.phase();
  if (show_) show_(progress);
  // An event that is lost is a pity, but no reason to lose the job.
  if (const absl::Status status = store_.AddProgress(lease_, progress); !status.ok()) {
    if (errors::IsStoreAway(status)) return;  // logged by the store
    monitoring::Log(monitoring::LogLevel::kWarning, "progress not stored",
                    {{"job", lease_.job}, {"error", std::string(status.message())}});
    return;
  }
  ++last_sequence_;
  news_.Publish(lease_.job);
}

}  // namespace maneuver::jobs
