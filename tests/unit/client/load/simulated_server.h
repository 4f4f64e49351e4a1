// A server and its callers in simulated time: every test is deterministic and takes no time.

#ifndef MANEUVER_TESTS_UNIT_CLIENT_LOAD_SIMULATED_SERVER_H_
#define MANEUVER_TESTS_UNIT_CLIENT_LOAD_SIMULATED_SERVER_H_

#include <algorithm>
#include <functional>
#include <map>
#include <utility>
#include <vector>

#include "client/load/load_run.h"

namespace maneuver::load {

using std::chrono::nanoseconds;

// Time advances while somebody waits, from event to event.
class SimulatedTimeline final : public Timeline {
 public:
  TimePoint Now() override { return now_; }
  void Wait(TimePoint until, const std::function<bool()>& condition) override {
    while (!condition()) {
      if (events_.empty() || events_.begin()->first > until) {
        now_ = std::max(now_, until);
        return;
      }
      const auto event = events_.extract(events_.begin());
      now_ = std::max(now_, event.key());
      event.mapped()();
    }
  }
  void Wake() override {}

  void At(TimePoint time, std::function<void()> event) { events_.emplace(time, std::move(event)); }
  nanoseconds elapsed() const { return now_ - TimePoint(); }

 private:
  TimePoint now_;
  std::multimap<TimePoint, std::function<void()>> events_;
};

// Answers one call after another, in order.
class SimulatedServer final : public Callee {
 public:
  explicit SimulatedServer(SimulatedTimeline& timeline) : timeline_(timeline) {}

  nanoseconds service_time = std::chrono::milliseconds(1);
  // The server stalls between these times.
  TimePoint stalls = TimePoint::max();
  TimePoint goes_on = TimePoint::max();
  // Overrides the answer to call number n, from 0; may be empty.
  std::function<absl::Status(int n)> answer;

  struct Seen {
    TimePoint at;
    nanoseconds timeout;
    uint64_t choice;
  };
  std::vector<Seen> seen;
  int in_flight = 0;
  int most_in_flight = 0;
  int cancellations = 0;

  void Start(const PlannedCall& call, std::function<void(const CallOutcome&)> on_end) override {
    const TimePoint now = timeline_.Now();
    const int number = static_cast<int>(seen.size());
    seen.push_back({now, call.timeout, call.choice});
    most_in_flight = std::max(most_in_flight, ++in_flight);
    const TimePoint begin = std::max(now, free_);
    TimePoint done = begin + service_time;
    if (done > stalls && begin < goes_on) {
      done = goes_on == TimePoint::max() ? goes_on : goes_on + service_time;
    }
    CallOutcome outcome{answer ? answer(number) : absl::OkStatus(), 1};
    if (done > now + call.timeout) {
      done = now + call.timeout;
      outcome = {absl::DeadlineExceededError("late")};
    } else {
      free_ = done;
    }
    timeline_.At(done, End(number, on_end, outcome));
    pending_[number] = std::move(on_end);
  }

  void CancelAll() override {
    ++cancellations;
    for (const auto& [number, on_end] : pending_) {
      timeline_.At(timeline_.Now(), End(number, on_end, {absl::CancelledError("given up")}));
    }
  }

 private:
  // Ends each call once, by whatever comes first.
  std::function<void()> End(int number, std::function<void(const CallOutcome&)> on_end,
                            const CallOutcome& outcome) {
    return [this, number, on_end = std::move(on_end), outcome] {
      if (pending_.erase(number) == 0) return;
      --in_flight;
      on_end(outcome);
    };
  }

  SimulatedTimeline& timeline_;
  TimePoint free_;
  std::map<int, std::function<void(const CallOutcome&)>> pending_;
};

}  // namespace maneuver::load

#endif  // MANEUVER_TESTS_UNIT_CLIENT_LOAD_SIMULATED_SERVER_H_
