#include "client/load/tally.h"

#include <algorithm>

#include "client/error_details.h"

namespace maneuver::load {

bool IsOverload(absl::StatusCode code) {
  return code == absl::StatusCode::kResourceExhausted ||
         code == absl::StatusCode::kDeadlineExceeded;
}

int64_t Tally::Ended(absl::StatusCode code) const {
  const auto found = ended.find(code);
  return found == ended.end() ? 0 : found->second;
}

int64_t Tally::Failed() const {
  int64_t failed = 0;
  for (const auto& [code, count] : ended) {
    if (code != absl::StatusCode::kOk && !IsOverload(code)) failed += count;
  }
  return failed;
}

double Tally::Rate(int64_t count) const {
  const double seconds = std::chrono::duration<double>(length).count();
  return seconds > 0.0 ? static_cast<double>(count) / seconds : 0.0;
}

void Tally::Add(const Window& window, TimePoint due_at, TimePoint sent_at, TimePoint ended_at,
                const CallOutcome& outcome) {
  if (outcome.status.ok() && window.Contains(ended_at)) {
    ++answered_calls;
    answered_targets += outcome.targets;
  }
  if (!window.Contains(due_at)) return;
  ++due;
  ++ended[outcome.status.code()];
  lateness.Record(sent_at - due_at);
  refused_targets += outcome.refused_targets;
  if (outcome.status.ok()) {
    answer_latency.Record(ended_at - due_at);
    if (outcome.refused_targets > 0 && failure.ok()) {
      failure = absl::InvalidArgumentError(outcome.refusal);
    }
  } else if (absl::IsResourceExhausted(outcome.status)) {
    refusal_latency.Record(ended_at - due_at);
    const client::ErrorDetails details = client::ErrorDetailsOf(outcome.status);
    if (details.reason == client::kHeldBack) ++held_back;
    if (details.retry_delay) {
      const std::chrono::nanoseconds time = absl::ToChronoNanoseconds(*details.retry_delay);
      least_delay = refused_with_delay == 0 ? time : std::min(least_delay, time);
      most_delay = std::max(most_delay, time);
      ++refused_with_delay;
    }
  } else if (!IsOverload(outcome.status.code()) && failure.ok()) {
    failure = outcome.status;
  }
}

}  // namespace maneuver::load
