// What became of the calls of a run.

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
struct Outcome {
  absl::Status status;       // with the server's details; see ErrorDetailsOf
  int targets = 0;           // answered
  int refused_targets = 0;   // refused inside an answer; the status is then OK
  std::string refusal = {};  // of one of them
};

// A stretch of a run in which it is measured.
struct Window {
  TimePoint begin;
  TimePoint end;
  bool Contains(TimePoint time) const { return begin <= time && time < end; }
};

// Calls are counted by when they were due; what was achieved (answered_*) by when it was, so that
// work piled up in the window and done after it does not count as done in it. Not thread-safe.
struct Tally {
  // Of calls that were due in the window:
  int64_t due = 0;
  int64_t unsent = 0;      // more were in flight than the generator may have
  int64_t unfinished = 0;  // had not ended when the run did
  std::map<absl::StatusCode, int64_t> ended;
  // Time from when a call was due to when its end was known. A call that could not be sent when it
  // was due has waited as well: that is how coordinated omission is kept out.
  LatencyHistogram answer_latency;   // of those that ended OK
  LatencyHistogram refusal_latency;  // of those that ended RESOURCE_EXHAUSTED
  LatencyHistogram lateness;         // from due to sent: the generator's own part
  // Of RESOURCE_EXHAUSTED ones:
  int64_t refused_with_delay = 0;  // that carried google.rpc.RetryInfo
  std::chrono::nanoseconds least_delay{0};
  std::chrono::nanoseconds most_delay{0};
  int64_t held_back = 0;  // by the client library, which spares the server: it never saw them
  int64_t refused_targets = 0;
  // The first that failed with something that more load does not explain; OK if none did. Codes
  // that overload explains are RESOURCE_EXHAUSTED and DEADLINE_EXCEEDED.
  absl::Status failure;

  // Of all calls, by when they ended in the window:
  int64_t answered_calls = 0;
  int64_t answered_targets = 0;

  std::chrono::nanoseconds length{0};  // of the window

  int64_t Ended(absl::StatusCode code) const;
  // Those that ended neither OK nor with a code that overload explains.
  int64_t Failed() const;
  // A second.
  double OfferedRate() const { return Rate(due); }
  double AnsweredRate() const { return Rate(answered_calls); }
  double AnsweredTargetRate() const { return Rate(answered_targets); }

  // A call has ended.
  void Add(const Window& window, TimePoint due_at, TimePoint sent_at, TimePoint ended_at,
           const Outcome& outcome);

 private:
  double Rate(int64_t count) const;
};

// Whether a server that has too much to do may say this.
bool IsOverload(absl::StatusCode code);

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_TALLY_H_
