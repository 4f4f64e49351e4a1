#include "model/machine/usable_cores.h"

#include <sched.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <thread>

#include "model/machine/control_group.h"

namespace maneuver::machine {
namespace {

namespace fs = std::filesystem;

int AllowedCores() {
  cpu_set_t allowed;
  if (sched_getaffinity(0, sizeof(allowed), &allowed) == 0) return CPU_COUNT(&allowed);
  // The machine has more cores than the set can hold.
  return static_cast<int>(std::thread::hardware_concurrency());
}

// Reads cpu.max: "QUOTA PERIOD", microseconds, or "max PERIOD".
std::optional<double> LimitIn(const fs::path& folder) {
  std::ifstream file(folder / "cpu.max");
  double quota = 0.0;
  double period = 0.0;
  if (!(file >> quota >> period) || quota <= 0.0 || period <= 0.0) return std::nullopt;
  return quota / period;
}

}  // namespace

std::optional<double> GroupLimit(const fs::path& root, const fs::path& group) {
  return LeastLimit(root, group, LimitIn);
}

int UsableCores() {
  int cores = AllowedCores();
  if (const auto group = OwnControlGroup()) {
    if (const auto limit = GroupLimit(kControlGroups, *group)) {
      cores = std::min(cores, static_cast<int>(std::ceil(*limit)));
    }
  }
  return std::max(1, cores);
}

}  // namespace maneuver::machine
