#include "client/load/load_run.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <random>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "client/error_details.h"
#include "locks/mutex.h"

namespace maneuver::load {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr milliseconds kLook{50};      // between checks of what to do and show
constexpr milliseconds kRest{10};      // the least pause of a refused caller
constexpr milliseconds kGrace{1'000};  // for a call to notice that its time is over

nanoseconds FromMilliseconds(double time) { return nanoseconds(std::llround(time * 1e6)); }

class LoadRun {
 public:
  LoadRun(const LoadPlan& plan, Callee& callee, Timeline& timeline, client::Cancellation& stop,
          const std::function<void(const Progress&)>& on_progress)
      : plan_(plan),
        callee_(callee),
        timeline_(timeline),
        on_progress_(on_progress),
        random_(plan.seed),
        start_(timeline.Now()),
        window_{start_ + plan.warm_up, start_ + plan.warm_up + plan.duration},
        on_stop_(&stop, [this] {
          stopped_ = true;
          timeline_.Wake();
        }) {}

  Tally Measure() {
    if (const auto* open = std::get_if<OpenLoop>(&plan_.loop)) {
      CallAtTimes(*open);
    } else {
      CallAgainAndAgain(std::get<ClosedLoop>(plan_.loop).callers);
    }
    return End();
  }

 private:
  void CallAtTimes(const OpenLoop& open) {
    // The seed differs, so that drawing requests and deadlines does not shift the times.
    Arrivals arrivals(open.arrivals, open.rate, plan_.seed ^ 0x9e3779b97f4a7c15);
    while (MayBegin()) {
      const TimePoint due = start_ + arrivals.Next();
      if (due >= window_.end) return WaitUntil(window_.end, [] { return false; });
      WaitUntil(due, [] { return false; });
      if (in_flight_ >= plan_.max_in_flight) {
        WaitUntil(window_.end, [this] { return in_flight_ < plan_.max_in_flight; });
        had_place_ = timeline_.Now();
      }
      if (stopped_) return;
      if (in_flight_ < plan_.max_in_flight) {
        if (due < had_place_ && window_.Contains(due)) ++waited_;
        Begin(due);
      } else if (window_.Contains(due)) {
        ++unsent_;
      }
    }
  }

  void CallAgainAndAgain(int callers) {
    for (int i = 0; i < callers && MayBegin(); ++i) Begin(timeline_.Now());
    while (!stopped_ && timeline_.Now() < window_.end && (MayBegin() || in_flight_ > 0)) {
      for (int rested = TakeRested(); rested > 0 && MayBegin(); --rested) Begin(timeline_.Now());
      WaitUntil(std::min(timeline_.Now() + kLook, window_.end),
                [this] { return in_flight_ == 0 && !MayBegin(); });
    }
  }

  Tally End() {
    ended_ = true;
    const nanoseconds longest =
        plan_.deadline ? FromMilliseconds(plan_.deadline->most) : plan_.patience;
    WaitUntil(timeline_.Now() + longest + kGrace, [this] { return in_flight_ == 0; });
    Tally tally;
    {
      const MutexLock lock(mutex_);
      counting_ = false;
      tally = tally_;
      tally.unfinished = due_under_way_;
    }
    tally.unsent = unsent_;
    tally.waited = waited_;
    tally.due += tally.unsent + tally.unfinished;
    tally.length = std::max(nanoseconds(0), std::min(timeline_.Now(), window_.end) - window_.begin);
    tally.only_warm_up = tally.due == 0 && !stopped_ && plan_.calls && begun_ >= *plan_.calls;
    if (in_flight_ > 0) callee_.CancelAll();
    while (in_flight_ > 0) {
      timeline_.Wait(timeline_.Now() + kLook, [this] { return in_flight_ == 0; });
    }
    return tally;
  }

  bool MayBegin() const { return !stopped_ && (!plan_.calls || begun_ < *plan_.calls); }

  // Waits and shows progress. Ends early if the load run is stopped.
  template <typename Condition>
  void WaitUntil(TimePoint until, const Condition& condition) {
    const auto done = [&] { return stopped_ || condition(); };
    while (true) {
      Show();
      const TimePoint look = std::min(until, timeline_.Now() + kLook);
      timeline_.Wait(look, done);
      if (done() || timeline_.Now() >= until) return;
    }
  }

  void Show() {
    if (!on_progress_) return;
    const TimePoint now = timeline_.Now();
    if (now < next_show_) return;
    next_show_ = now + 2 * kLook;
    Progress progress;
    const std::chrono::duration<double> all = window_.end - start_;
    progress.fraction = std::min(1.0, std::chrono::duration<double>(now - start_) / all);
    progress.warming_up = now < window_.begin;
    progress.in_flight = in_flight_;
    on_progress_(progress);
  }

  // Begins a call, from any thread. Does nothing if enough calls have begun.
  void Begin(TimePoint due) {
    if (const int64_t before = begun_++; plan_.calls && before >= *plan_.calls) return;
    ++in_flight_;
    PlannedCall call;
    nanoseconds allowed = plan_.patience;
    {
      const MutexLock lock(mutex_);
      call.choice = random_();
      if (plan_.deadline) {
        const auto& [least, most] = *plan_.deadline;
        allowed = FromMilliseconds(least + (most - least) * Uniform(random_));
      }
      if (window_.Contains(due)) ++due_under_way_;
    }
    const TimePoint sent = timeline_.Now();
    call.timeout = due + allowed - sent;
    callee_.Start(call,
                  [this, due, sent](const CallOutcome& outcome) { OnEnd(due, sent, outcome); });
  }

  void OnEnd(TimePoint due, TimePoint sent, const CallOutcome& outcome) {
    const TimePoint now = timeline_.Now();
    {
      const MutexLock lock(mutex_);
      if (window_.Contains(due)) --due_under_way_;
      if (counting_ && !stopped_) tally_.Add(window_, due, sent, now, outcome);
    }
    if (std::holds_alternative<ClosedLoop>(plan_.loop) && !ended_ && now < window_.end) {
      CallerIsFree(now, outcome.status);
    }
    // Counting the last call may destroy this object at once.
    Timeline& timeline = timeline_;
    const int64_t limit = plan_.max_in_flight;
    const int64_t before = in_flight_.fetch_sub(1);
    if (before == 1 || before == limit) timeline.Wake();
  }

  void CallerIsFree(TimePoint now, const absl::Status& status) {
    if (status.ok() || absl::IsDeadlineExceeded(status)) {
      if (MayBegin()) Begin(now);
      return;
    }
    const auto delay = client::ErrorDetailsOf(status).retry_delay;
    const nanoseconds told = delay ? absl::ToChronoNanoseconds(*delay) : nanoseconds(0);
    const MutexLock lock(mutex_);
    resting_.push_back(now + std::max<nanoseconds>(told, kRest));
  }

  // Returns how many callers have rested enough.
  int TakeRested() {
    const TimePoint now = timeline_.Now();
    const MutexLock lock(mutex_);
    return static_cast<int>(std::erase_if(resting_, [now](TimePoint end) { return end <= now; }));
  }

  const LoadPlan& plan_;
  Callee& callee_;
  Timeline& timeline_;
  const std::function<void(const Progress&)>& on_progress_;

  Mutex mutex_;
  std::mt19937_64 random_ ABSL_GUARDED_BY(mutex_);
  Tally tally_ ABSL_GUARDED_BY(mutex_);
  int64_t due_under_way_ ABSL_GUARDED_BY(mutex_) = 0;  // due in the window
  bool counting_ ABSL_GUARDED_BY(mutex_) = true;
  // When each resting caller may call again.
  std::vector<TimePoint> resting_ ABSL_GUARDED_BY(mutex_);

  std::atomic<bool> stopped_ = false;
  std::atomic<bool> ended_ = false;  // no call begins any more
  std::atomic<int64_t> begun_ = 0;
  std::atomic<int64_t> in_flight_ = 0;
  int64_t unsent_ = 0;
  int64_t waited_ = 0;
  TimePoint had_place_{};  // when a call that had waited for others to end could be sent
  TimePoint next_show_{};
  const TimePoint start_;
  const Window window_;
  const client::Cancellation::Registration on_stop_;
};

}  // namespace

Tally RunLoad(const LoadPlan& plan, Callee& callee, Timeline& timeline, client::Cancellation& stop,
              const std::function<void(const Progress&)>& on_progress) {
  return LoadRun(plan, callee, timeline, stop, on_progress).Measure();
}

}  // namespace maneuver::load
