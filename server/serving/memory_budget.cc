#include "server/serving/memory_budget.h"

#include <fcntl.h>
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <utility>

#include "server/errors/error_details.h"

namespace maneuver::serving {
namespace {

// Of the limit.
constexpr double kAdmitted = 0.8;
constexpr std::chrono::milliseconds kInterval{20};
// It holds up every thread that allocates.
constexpr std::chrono::seconds kBetweenFreeing{1};
constexpr std::chrono::milliseconds kDelayWhenFull{200};
// Smaller requests are seen soon enough once they take memory.
constexpr int64_t kLargeRequest = int64_t{64} << 10;
// A scene of many small messages takes four to five times its bytes on the wire once it is parsed,
// and as much again for what is derived from it.
constexpr int64_t kParsedFactor = 8;

// Resident pages that belong to no file: what a control group counts and cannot drop.
// /proc/self/statm is "size resident shared ...", in pages; shared ones belong to files.
int64_t AnonymousBytes() {
  char text[128];
  const int file = open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
  if (file < 0) return 0;
  const ssize_t length = read(file, text, sizeof text - 1);
  close(file);
  if (length <= 0) return 0;
  text[length] = '\0';
  long long resident = 0;
  long long shared = 0;
  if (std::sscanf(text, "%*d %lld %lld", &resident, &shared) != 2) return 0;
  return (resident - shared) * sysconf(_SC_PAGESIZE);
}

}  // namespace

MemoryBudget::MemoryBudget(int64_t limit, monitoring::MetricRegistry& metrics)
    : MemoryBudget(
          limit, AnonymousBytes, [] { malloc_trim(0); }, metrics) {
  if (limit_ > 0) thread_ = std::thread([this] { Watch(); });
}

MemoryBudget::MemoryBudget(int64_t limit, std::function<int64_t()> used,
                           std::function<void()> free_unused, monitoring::MetricRegistry& metrics)
    : limit_(limit), used_(std::move(used)), free_unused_(std::move(free_unused)) {
  if (limit_ <= 0) return;
  used_gauge_ =
      &metrics.AddGauge("maneuver_memory_bytes", "Memory of the server, without pages of files.");
  metrics.AddGauge("maneuver_memory_limit_bytes", "Most bytes of maneuver_memory_bytes.")
      .Set(static_cast<double>(limit_));
  refusals_ = &metrics.AddCounter("maneuver_memory_refusals_total",
                                  "Calls refused because the server's memory was nearly full.");
  closed_ = &metrics.AddCounter("maneuver_memory_closed_connections_total",
                                "Connections closed because the server's memory was nearly full "
                                "and they had sent the most.");
}

MemoryBudget::~MemoryBudget() {
  stop_.Stop();
  if (thread_.joinable()) thread_.join();
}

absl::Status MemoryBudget::Admit() { return is_full_ ? Refuse() : absl::OkStatus(); }

absl::StatusOr<std::shared_ptr<const void>> MemoryBudget::AdmitRequest(int64_t bytes) {
  if (is_full_) return Refuse();
  if (limit_ <= 0 || bytes < kLargeRequest) return std::shared_ptr<const void>();
  const int64_t needed = kParsedFactor * bytes;
  {
    const MutexLock lock(reserving_);
    const double most = kAdmitted * static_cast<double>(limit_);
    if (static_cast<double>(used_() + reserved_ + needed) <= most) {
      reserved_ += needed;
      return std::shared_ptr<const void>(this, [this, needed](const void*) { Release(needed); });
    }
  }
  is_short_ = true;
  return Refuse();
}

void MemoryBudget::Release(int64_t bytes) {
  const MutexLock lock(reserving_);
  reserved_ -= bytes;
}

absl::Status MemoryBudget::Refuse() {
  refusals_->Increment();
  return errors::WithRetryDelay(
      errors::WithReason(absl::ResourceExhaustedError(
                             "the server's memory is nearly full; try again a little later"),
                         "MEMORY_FULL"),
      kDelayWhenFull);
}

void MemoryBudget::RelieveBy(std::function<int(double part)> relieve) {
  const MutexLock lock(looking_);
  relieve_ = std::move(relieve);
}

void MemoryBudget::Relieve() {
  if (limit_ <= 0) return;
  const MutexLock lock(looking_);
  const double most = kAdmitted * static_cast<double>(limit_);
  auto used = static_cast<double>(used_());
  // First: to free what is unused may take long.
  if (relieve_) closed_->Increment(relieve_(used / static_cast<double>(limit_)));
  const auto now = std::chrono::steady_clock::now();
  if ((used > most || is_short_) && now >= may_free_from_) {
    is_full_ = used > most;
    free_unused_();
    is_short_ = false;
    may_free_from_ = now + kBetweenFreeing;
    used = static_cast<double>(used_());
  }
  used_gauge_->Set(used);
  is_full_ = used > most;
}

void MemoryBudget::Watch() {
  do {
    Relieve();
  } while (!stop_.StoppedWithin(kInterval));
}

int64_t ShareOf(int64_t limit, int parts, int64_t configured) {
  return limit <= 0 ? configured : std::min(configured, std::max<int64_t>(1, limit / parts));
}

}  // namespace maneuver::serving
