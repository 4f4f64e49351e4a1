// Finds how many threads of this process can run at the same time.

#ifndef MANEUVER_MODEL_MACHINE_USABLE_CORES_H_
#define MANEUVER_MODEL_MACHINE_USABLE_CORES_H_

#include <filesystem>
#include <optional>

namespace maneuver::machine {

// Returns the number of cores that the calling thread may run on (taskset, a container's cpuset),
// limited to the time that its control groups allow (a container's core limit), rounded up. At
// least 1. std::thread::hardware_concurrency() would count all cores of the machine. With two
// threads on a core that can run one, both finish late.
int UsableCores();

// Returns the smallest CPU limit of a control group and of the groups that contain it, in cores.
// Returns nothing if there is none.
//   root: the mount point of version 2, /sys/fs/cgroup.
//   group: "/a/b", as in /proc/self/cgroup.
std::optional<double> GroupLimit(const std::filesystem::path& root,
                                 const std::filesystem::path& group);

}  // namespace maneuver::machine

#endif  // MANEUVER_MODEL_MACHINE_USABLE_CORES_H_
