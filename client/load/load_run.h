// One run of load: calls at their times, and what becomes of them.

#ifndef MANEUVER_CLIENT_LOAD_LOAD_RUN_H_
#define MANEUVER_CLIENT_LOAD_LOAD_RUN_H_

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <variant>

#include "client/cancellation.h"
#include "client/load/arrivals.h"
#include "client/load/tally.h"
#include "client/load/timeline.h"

namespace maneuver::load {

// Callers who do not wait for one another: what users are to a server. If it is slow, they do not
// come less often.
struct OpenLoop {
  double rate = 1.0;  // calls a second, > 0
  ArrivalProcess arrivals = ArrivalProcess::kPoisson;
};

// So many callers, each of whom asks again as soon as it was answered: finds out what the server
// can do. One that was refused or failed rests first: as long as it was told, or 10 ms.
struct ClosedLoop {
  int callers = 1;
};

// Milliseconds that calls may take, drawn uniformly for each.
struct DeadlineRange {
  double least = 0.0;
  double most = 0.0;
};

struct LoadPlan {
  std::variant<OpenLoop, ClosedLoop> loop = ClosedLoop{};
  std::chrono::nanoseconds warm_up{0};  // not measured
  std::chrono::nanoseconds duration{std::chrono::seconds(10)};
  std::optional<int64_t> calls = {};  // end after so many, warm-up included
  std::optional<DeadlineRange> deadline =
      {};  // counted from when a call was due; nothing: `patience`
  // Of an open loop; calls beyond wait for their turn, and are late.
  int max_in_flight = 10'000;
  // How long calls may take without a deadline.
  std::chrono::nanoseconds patience{std::chrono::seconds(30)};
  uint64_t seed = 1;
};

struct PlannedCall {
  uint64_t choice = 0;                  // which request, random
  std::chrono::nanoseconds timeout{0};  // from now; may be negative
};

// Who is called.
class Callee {
 public:
  virtual ~Callee() = default;

  // Starts a call and returns. `on_end` is called once, not from within Start, on any thread.
  virtual void Start(const PlannedCall& call, std::function<void(const Outcome&)> on_end) = 0;
  // Ends all calls that are under way, and all that are started later, soon.
  virtual void CancelAll() = 0;
};

struct Progress {
  double fraction = 0.0;  // of the run's time
  bool warming_up = false;
  int64_t in_flight = 0;
};

// Runs to the end, waits for the calls that were due until then (as long as they may take, no
// longer), and returns what became of them. When it returns, no call is under way.
//   timeline: outlives the callee's calls.
//   stop: once cancelled, calls under way are given up, and the window ends there.
//   on_progress: every 100 ms or so; may be empty.
Tally RunLoad(const LoadPlan& plan, Callee& callee, Timeline& timeline, client::Cancellation& stop,
              const std::function<void(const Progress&)>& on_progress = {});

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_LOAD_RUN_H_
