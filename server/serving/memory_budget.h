// One limit for the memory of the whole server, whatever uses it: requests, answers that nobody
// reads, uploads, maps, watchers, models. Near the limit calls are refused, so that the system does
// not end the server.

#ifndef MANEUVER_SERVER_SERVING_MEMORY_BUDGET_H_
#define MANEUVER_SERVER_SERVING_MEMORY_BUDGET_H_

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "locks/mutex.h"
#include "locks/stop_latch.h"
#include "server/monitoring/metrics.h"

namespace maneuver::serving {

// Safe to use from any thread.
class MemoryBudget {
 public:
  // Watches the memory of this process, fifty times a second, and shows it as a metric.
  //   limit: bytes of anonymous memory; 0: any number, and nothing is watched
  MemoryBudget(int64_t limit, monitoring::MetricRegistry& metrics);
  // The same over other sources, for tests. No thread watches: only Relieve() does.
  //   used: returns the bytes in use
  //   free_unused: gives memory that was freed back to the system
  MemoryBudget(int64_t limit, std::function<int64_t()> used, std::function<void()> free_unused,
               monitoring::MetricRegistry& metrics);
  ~MemoryBudget();
  MemoryBudget(const MemoryBudget&) = delete;
  MemoryBudget& operator=(const MemoryBudget&) = delete;

  // Returns OK if at most 80 % of the limit was in use at the last look. The rest is for the calls
  // that were admitted before. Otherwise RESOURCE_EXHAUSTED with the reason MEMORY_FULL and a retry
  // delay. Takes no lock.
  absl::Status Admit();

  // The same for a call with a request of `bytes` on the wire. A large one takes several times that
  // once it is parsed, which must fit as well. Keep the result until then: it reserves the memory
  // while nobody can see it yet. It must not outlive this object.
  absl::StatusOr<std::shared_ptr<const void>> AdmitRequest(int64_t bytes);

  // Lets every look call `relieve` with the part of the limit that is in use. It lets go of what was
  // never admitted, such as messages that are still being received, and returns how many
  // connections it closed for that.
  void RelieveBy(std::function<int(double part)> relieve);

  // Looks at the memory now. If it is full, or a call was refused, frees what is unused, at most
  // once a second, and looks again.
  void Relieve();

 private:
  void Watch();
  absl::Status Refuse();
  void Release(int64_t bytes);

  const int64_t limit_;
  const std::function<int64_t()> used_;
  const std::function<void()> free_unused_;
  monitoring::Gauge* used_gauge_ = nullptr;
  monitoring::Counter* refusals_ = nullptr;
  monitoring::Counter* closed_ = nullptr;
  std::atomic<bool> is_full_ = false;
  std::atomic<bool> is_short_ = false;  // a large request did not fit
  Mutex looking_;
  std::function<int(double)> relieve_ ABSL_GUARDED_BY(looking_);
  std::chrono::steady_clock::time_point may_free_from_ ABSL_GUARDED_BY(looking_){};
  Mutex reserving_;
  int64_t reserved_ ABSL_GUARDED_BY(reserving_) = 0;
  StopLatch stop_;
  std::thread thread_;
};

// Returns how many bytes a buffer may have: `configured`, but under a limit at most one part in
// `parts` of it.
int64_t ShareOf(int64_t limit, int parts, int64_t configured);

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_MEMORY_BUDGET_H_
