// Simulates a disk that fails, fills up or loses its power at a chosen moment.
//
// A program that links it gets its versions of open, write, fsync, link, rename, renameat2 and
// mkdir instead of the C library's; so do all libraries in the program. Operations below one folder
// are counted and can be made to fail. All others are passed on. Use it from one thread only.

#ifndef MANEUVER_TESTS_DURABILITY_FAULTY_DISK_H_
#define MANEUVER_TESTS_DURABILITY_FAULTY_DISK_H_

#include <filesystem>

namespace maneuver::durability {

enum class Fault {
  kNone,
  // One operation fails with EIO.
  kError,
  // From one operation on, nothing can be written or created: ENOSPC. The first write that fails
  // has written half of its bytes.
  kFull,
  // The process ends with kPowerCutStatus. Files that were written and not synced are empty. Names
  // that were created or changed in a folder that was not synced are as before.
  kPowerCutNames,
  // The same, but these names are as they were meant to be. On a real disk either can happen.
  kPowerCut,
};

constexpr int kPowerCutStatus = 42;

// Arms `fault` for operation `at` (from 0) below `root`, an absolute path.
void Arm(const std::filesystem::path& root, Fault fault = Fault::kNone, int at = 0);
// Disarms. Returns the number of operations below `root` since Arm.
int Disarm();
// Cuts the power now, in the way that was armed. Does not return.
[[noreturn]] void CutPower();

}  // namespace maneuver::durability

#endif  // MANEUVER_TESTS_DURABILITY_FAULTY_DISK_H_
