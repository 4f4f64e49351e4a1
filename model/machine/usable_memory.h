// Finds how much memory this process may use.

#ifndef MANEUVER_MODEL_MACHINE_USABLE_MEMORY_H_
#define MANEUVER_MODEL_MACHINE_USABLE_MEMORY_H_

#include <cstdint>
#include <filesystem>
#include <optional>

namespace maneuver::machine {

// Returns the memory of the machine, or the limit of its control groups if that is less, bytes.
int64_t UsableMemory();

// Returns the smallest memory.max of a control group and of the groups that contain it, bytes.
// Returns nothing if there is none. Arguments: as LeastLimit.
std::optional<int64_t> GroupMemoryLimit(const std::filesystem::path& root,
                                        const std::filesystem::path& group);

}  // namespace maneuver::machine

#endif  // MANEUVER_MODEL_MACHINE_USABLE_MEMORY_H_
