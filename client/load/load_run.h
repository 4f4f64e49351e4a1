// One load run: makes calls at their times and records how they end.

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

// Callers who do not wait for each other, like a server's users. If the server is slow, they do not
// call less often.
struct OpenLoop {
  double rate = 1.0;  // calls per second, > 0
  ArrivalProcess arrivals = ArrivalProcess::kPoisson;
};

// Each caller calls again as soon as its call was answered or timed out. This measures the server's
// capacity. If a call ended in another way, its caller first waits for the retry delay that the
// server sent, and for at least 10 ms.
struct ClosedLoop {
  int callers = 1;
};

// The deadline of a call, in milliseconds from when the call is due. Drawn uniformly for each call.
struct DeadlineRange {
  double least = 0.0;
  double most = 0.0;
};

struct LoadPlan {
  std::variant<OpenLoop, ClosedLoop> loop = ClosedLoop{};
  std::chrono::nanoseconds warm_up{0};  // not measured
  std::chrono::nanoseconds duration{std::chrono::seconds(10)};
  std::optional<int64_t> calls = {};           // ends after this many, warm-up included
  std::optional<DeadlineRange> deadline = {};  // without it, a call may take `patience`
  // For an open loop. Calls beyond this wait for their turn and are late. Those that still wait
  // when the load run ends are not sent (Tally::unsent).
  int max_in_flight = 10'000;
  // How long a call without a deadline may take.
  std::chrono::nanoseconds patience{std::chrono::seconds(30)};
  uint64_t seed = 1;
};

struct PlannedCall {
  uint64_t choice = 0;                  // which request, random
  std::chrono::nanoseconds timeout{0};  // from now; may be negative
};

// The server that is called.
class Callee {
 public:
  virtual ~Callee() = default;

  // Starts a call and returns. `on_end` is called once, on any thread, but not during Start.
  virtual void Start(const PlannedCall& call, std::function<void(const CallOutcome&)> on_end) = 0;
  // Ends all calls in progress soon, and all that start later.
  virtual void CancelAll() = 0;
};

struct Progress {
  double fraction = 0.0;  // of the load run's time
  bool warming_up = false;
  int64_t in_flight = 0;
};

// Runs the plan to its end, then waits until every call that was due has ended or reached its
// deadline. Returns the results. When it returns, no call is in progress.
//   timeline: must outlive the callee's calls.
//   stop: once cancelled, the window ends, and calls in progress are cancelled and not counted.
//   on_progress: called about every 100 ms; may be empty.
Tally RunLoad(const LoadPlan& plan, Callee& callee, Timeline& timeline, client::Cancellation& stop,
              const std::function<void(const Progress&)>& on_progress = {});

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_LOAD_RUN_H_
