// How many threads of this process can run at the same time.

#ifndef MANEUVER_MODEL_MACHINE_USABLE_CORES_H_
#define MANEUVER_MODEL_MACHINE_USABLE_CORES_H_

#include <filesystem>
#include <optional>

namespace maneuver::machine {

// Cores that the calling thread may run on (taskset, a container's cpuset), but no more than what
// its control groups give it time for (a container's limit of cores), rounded up. At least 1.
// std::thread::hardware_concurrency() is all cores of the machine, whoever may use them: two
// threads that work where one can run make each other late.
int UsableCores();

// The least limit of a control group and those that it is in, cores; nothing if there is none.
//   root: where version 2 is mounted, /sys/fs/cgroup;  group: "/a/b", as /proc/self/cgroup has it
std::optional<double> GroupLimit(const std::filesystem::path& root,
                                 const std::filesystem::path& group);

}  // namespace maneuver::machine

#endif  // MANEUVER_MODEL_MACHINE_USABLE_CORES_H_
