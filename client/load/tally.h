// Counts how the calls of a load run ended.

#ifndef MANEUVER_CLIENT_LOAD_TALLY_H_
#define MANEUVER_CLIENT_LOAD_TALLY_H_

#include <chrono>
#include <cstdint>
#include <map>
#include <string>

#include "absl/status/status.h"
#include "client/load/latency_histogram.h"
#include "client/load/timeline.h"

namespace maneuver::load {

// How one call ended.
struct CallOutcome {
  absl::Status status;       // with the server's details; see ErrorDetailsOf
  int targets = 0;           // answered
  int refused_targets = 0;   // refused within an answer whose status is OK
  std::string refusal = {};  // reason of one of these
};

// The part of a load run that is measured.
struct Window {
  TimePoint begin;
  TimePoint end;
  bool Contains(TimePoint time) const { return begin <= time && time < end; }
};

// Calls are counted by the time they were due, answers (answered_*) by the time they arrived: work
// that piled up in the window and ended after it does not count as answered. Not thread-safe.
struct Tally {
  // For calls that were due in the window:
  int64_t due = 0;
  int64_t unsent = 0;      // too many were in flight already
  int64_t waited = 0;      // sent late for that reason
  int64_t unfinished = 0;  // still in progress when the load run ended
  std::map<absl::StatusCode, int64_t> ended;
  // Latencies count from when a call was due to when its end was known. A call that could not be
  // sent in time has waited too, which avoids coordinated omission.
  LatencyHistogram answer_latency;   // of calls that ended OK
  LatencyHistogram refusal_latency;  // of calls that ended RESOURCE_EXHAUSTED
  LatencyHistogram lateness;         // from due to sent: the generator's own delay
  // For calls that ended RESOURCE_EXHAUSTED:
  int64_t refused_with_delay = 0;  // with google.rpc.RetryInfo
  std::chrono::nanoseconds least_delay{0};
  std::chrono::nanoseconds most_delay{0};
  int64_t held_back = 0;  // by the client library; the server never saw them

  int64_t refused_targets = 0;  // in answers whose status is OK
  // The first failure that more load does not explain; OK if there was none. Overload explains
  // RESOURCE_EXHAUSTED and DEADLINE_EXCEEDED. A refused target counts as INVALID_ARGUMENT.
  absl::Status failure;

  // For all calls that ended in the window, whenever they were due:
  int64_t answered_calls = 0;
  int64_t answered_targets = 0;

  std::chrono::nanoseconds length{0};  // of the window
  bool only_warm_up = false;           // the plan's calls were used up before the window

  int64_t Ended(absl::StatusCode code) const;
  // Returns how many calls ended neither OK nor with a code that overload explains.
  int64_t Failed() const;
  // Rates per second.
  double OfferedRate() const { return Rate(due); }
  double AnsweredRate() const { return Rate(answered_calls); }
  double AnsweredTargetRate() const { return Rate(answered_targets); }

  // Adds a call that has ended.
  void Add(const Window& window, TimePoint due_at, TimePoint sent_at, TimePoint ended_at,
           const CallOutcome& outcome);

 private:
  double Rate(int64_t count) const;
};

// Returns whether an overloaded server may answer with this code.
bool IsOverload(absl::StatusCode code);

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_TALLY_H_
