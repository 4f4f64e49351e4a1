// A disk that fails, fills up or loses its power at a chosen moment.
//
// Linked into a program it takes the place of open, write, fsync, link, rename, renameat2 and mkdir
// of the C library, for the program and all libraries in it. What they do below one folder is
// counted and can be made to fail; all else they pass on. One thread only.

#ifndef MANEUVER_TESTS_DURABILITY_FAULTY_DISK_H_
#define MANEUVER_TESTS_DURABILITY_FAULTY_DISK_H_

#include <filesystem>

namespace maneuver::durability {

enum class Fault {
  kNone,
  // One operation fails with EIO.
  kError,
  // From one operation on nothing can be written or created: ENOSPC. A write puts half there first.
  kFull,
  // The process ends with kPowerCut. Files that were written and not synced are empty; names that
  // were made or changed and whose folder was not synced are as they were before...
  kPowerCutNames,
  // ... or as they were to be: both may happen.
  kPowerCut,
};

constexpr int kPowerCutStatus = 42;

// From now on, below `root` (absolute), at operation `at`, from 0.
void Arm(const std::filesystem::path& root, Fault fault = Fault::kNone, int at = 0);
// As if nothing had been armed. Returns how many operations there were.
int Disarm();
// The power goes now; what was armed says how. Does not return.
[[noreturn]] void CutPower();

}  // namespace maneuver::durability

#endif  // MANEUVER_TESTS_DURABILITY_FAULTY_DISK_H_
