// The limits that Linux's control groups, version 2, set for this process.

#ifndef MANEUVER_MODEL_MACHINE_CONTROL_GROUP_H_
#define MANEUVER_MODEL_MACHINE_CONTROL_GROUP_H_

#include <filesystem>
#include <functional>
#include <optional>

namespace maneuver::machine {

inline constexpr char kControlGroups[] = "/sys/fs/cgroup";

// Returns the group of this process, such as "/a/b"; nothing if it has none.
std::optional<std::filesystem::path> OwnControlGroup();

// Returns the smallest limit of a group and of the groups that contain it; nothing if there is
// none.
//   root: the mount point, kControlGroups
//   limit_in: returns the limit that the files in a group's folder set
std::optional<double> LeastLimit(
    const std::filesystem::path& root, const std::filesystem::path& group,
    const std::function<std::optional<double>(const std::filesystem::path& folder)>& limit_in);

}  // namespace maneuver::machine

#endif  // MANEUVER_MODEL_MACHINE_CONTROL_GROUP_H_
