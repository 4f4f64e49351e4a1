// Temporaries in a folder that several processes write.

#ifndef MANEUVER_MODEL_FILES_ABANDONED_TEMPORARIES_H_
#define MANEUVER_MODEL_FILES_ABANDONED_TEMPORARIES_H_

#include <chrono>
#include <filesystem>

namespace maneuver::files {

// A temporary that has not changed for this long has no writer any more.
inline constexpr std::chrono::hours kAbandonedAfter{24};

// Removes the temporaries in `parent` (RemoveTemporaries, durable_file.h) that last changed
// kAbandonedAfter before `now` or earlier. Younger ones may belong to another process. What cannot
// be removed stays for the next call.
void RemoveAbandonedTemporaries(const std::filesystem::path& parent,
                                std::filesystem::file_time_type now);

}  // namespace maneuver::files

#endif  // MANEUVER_MODEL_FILES_ABANDONED_TEMPORARIES_H_
