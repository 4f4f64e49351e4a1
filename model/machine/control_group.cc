#include "model/machine/control_group.h"

#include <algorithm>
#include <fstream>
#include <string>

namespace maneuver::machine {

namespace fs = std::filesystem;

std::optional<fs::path> OwnControlGroup() {
  std::ifstream groups("/proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {
    if (line.starts_with("0::")) return line.substr(3);
  }
  return std::nullopt;
}

std::optional<double> LeastLimit(
    const fs::path& root, const fs::path& group,
    const std::function<std::optional<double>(const fs::path& folder)>& limit_in) {
  std::optional<double> least;
  fs::path folder = root;
  const auto look = [&] {
    const auto limit = limit_in(folder);
    if (limit) least = std::min(*limit, least.value_or(*limit));
  };
  look();  // inside a container, its own group is the root
  for (const fs::path& part : group.relative_path()) {
    folder /= part;
    look();
  }
  return least;
}

}  // namespace maneuver::machine
