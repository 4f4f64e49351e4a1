#include "server/maneuverd/idle_memory.h"

#include <malloc.h>

#include <algorithm>
#include <chrono>

#include "server/monitoring/process_metrics.h"

namespace maneuver {
namespace {

constexpr std::chrono::seconds kInterval{2};
// Less is kept for the next burst, which would have to fetch it again page by page.
constexpr double kMuch = 32 << 20;

// Memory of this process beyond what it has allocated: its programs, and what was freed.
double UnusedBytes() {
  const auto process = monitoring::ReadProcessMetrics();
  return process ? process->resident_bytes - process->allocated_bytes : 0.0;
}

}  // namespace

IdleMemory::IdleMemory() {
  mallopt(M_MMAP_THRESHOLD, 32 << 20);  // bytes: the most that is allowed
  mallopt(M_TRIM_THRESHOLD, 16 << 20);  // of each arena: malloc_trim cannot give back its end
  mallopt(M_TOP_PAD, 4 << 20);
  thread_ = std::thread([this] { Run(); });
}

IdleMemory::~IdleMemory() {
  stop_.Stop();
  thread_.join();
}

void IdleMemory::Run() {
  double before = UnusedBytes();
  double least = before;  // what cannot be given back
  while (!stop_.StoppedWithin(kInterval)) {
    const double now = UnusedBytes();
    if (std::min(before, now) < least + kMuch) {
      least = std::min(least, now);
      before = now;
      continue;
    }
    malloc_trim(0);
    before = least = UnusedBytes();
  }
}

}  // namespace maneuver
