#include "model/machine/usable_cores.h"

#include <sched.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>
#include <thread>

namespace maneuver::machine {
namespace {

namespace fs = std::filesystem;

int AllowedCores() {
  cpu_set_t allowed;
  if (sched_getaffinity(0, sizeof(allowed), &allowed) == 0) return CPU_COUNT(&allowed);
  // The machine has more cores than the set can hold.
  return static_cast<int>(std::thread::hardware_concurrency());
}

// Returns this process's control group, version 2: the path in the line "0::/a/b".
std::optional<fs::path> OwnGroup() {
  std::ifstream groups("/proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {
    if (line.starts_with("0::")) return line.substr(3);
  }
  return std::nullopt;
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
  std::optional<double> least;
  fs::path folder = root;
  const auto look = [&] {
    const auto limit = LimitIn(folder);
    if (limit) least = std::min(*limit, least.value_or(*limit));
  };
  look();  // inside a container, its own group is the root
  for (const fs::path& part : group.relative_path()) {
    folder /= part;
    look();
  }
  return least;
}

int UsableCores() {
  int cores = AllowedCores();
  if (const auto group = OwnGroup()) {
    if (const auto limit = GroupLimit("/sys/fs/cgroup", *group)) {
      cores = std::min(cores, static_cast<int>(std::ceil(*limit)));
    }
  }
  return std::max(1, cores);
}

}  // namespace maneuver::machine
