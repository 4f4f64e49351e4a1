#include "model/machine/usable_memory.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>

#include "model/machine/control_group.h"

namespace maneuver::machine {

std::optional<int64_t> GroupMemoryLimit(const std::filesystem::path& root,
                                        const std::filesystem::path& group) {
  const auto limit =
      LeastLimit(root, group, [](const std::filesystem::path& folder) -> std::optional<double> {
        std::ifstream file(folder / "memory.max");  // bytes, or "max"
        double bytes = 0.0;
        if (!(file >> bytes) || bytes <= 0.0) return std::nullopt;
        return bytes;
      });
  return limit ? std::optional(static_cast<int64_t>(*limit)) : std::nullopt;
}

int64_t UsableMemory() {
  const int64_t machine = int64_t{sysconf(_SC_PHYS_PAGES)} * sysconf(_SC_PAGESIZE);
  const auto group = OwnControlGroup();
  if (!group) return machine;
  return std::min(machine, GroupMemoryLimit(kControlGroups, *group).value_or(machine));
}

}  // namespace maneuver::machine
