#include "tests/durability/faulty_disk.h"

#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace maneuver::durability {
namespace {

namespace fs = std::filesystem;

// A name that was added to or removed from a folder, perhaps not yet on the disk.
struct Name {
  std::string from;      // what was renamed; empty: it was made
  std::string to;        // its name now
  std::string replaced;  // what had this name before, kept; empty: nothing
};

struct Disk {
  std::string root;  // with a slash at its end
  std::string kept;  // where replaced files are kept
  Fault fault = Fault::kNone;
  int at = 0;
  int operations = 0;
  std::set<std::string> unsynced;  // files
  std::vector<Name> names;         // in order
};

Disk* disk = nullptr;

bool Below(const std::string& path) { return disk != nullptr && path.starts_with(disk->root); }

std::string ParentOf(const std::string& path) { return path.substr(0, path.rfind('/')); }

std::string PathOf(int descriptor) {
  char path[4096];
  const ssize_t length =
      readlink(("/proc/self/fd/" + std::to_string(descriptor)).c_str(), path, sizeof path);
  return length < 0 ? std::string() : std::string(path, static_cast<size_t>(length));
}

// Begins one operation. Returns the error that it must end with, or 0. Does not return if the power
// is cut.
int Begin(bool needs_room) {
  const int operation = disk->operations++;
  const bool now = operation == disk->at;
  switch (disk->fault) {
    case Fault::kNone:
      return 0;
    case Fault::kError:
      return now ? EIO : 0;
    case Fault::kFull:
      return needs_room && operation >= disk->at ? ENOSPC : 0;
    case Fault::kPowerCut:
    case Fault::kPowerCutNames:
      if (now) CutPower();
      return 0;
  }
  return 0;
}

int Result(long result) {
  if (result >= 0) return static_cast<int>(result);
  errno = static_cast<int>(-result);
  return -1;
}

// Like syscall(2), which sets errno itself, but returns int.
template <typename... Arguments>
int Call(long number, Arguments... arguments) {
  return static_cast<int>(syscall(number, arguments...));
}

int Rename(const char* from, const char* to, unsigned flags) {
  if (Below(to)) {
    if (const int error = Begin(false); error != 0) return Result(-error);
    Name name = {from, to, ""};
    if (flags == 0 && access(to, F_OK) == 0) {
      name.replaced = disk->kept + std::to_string(disk->operations);
      if (Call(SYS_linkat, AT_FDCWD, to, AT_FDCWD, name.replaced.c_str(), 0) != 0) {
        name.replaced.clear();  // a folder
      }
    }
    const int result = Call(SYS_renameat2, AT_FDCWD, from, AT_FDCWD, to, flags);
    if (result != 0) return result;
    // The content of a folder moves with it.
    std::set<std::string> moved;
    for (const std::string& path : disk->unsynced) {
      const bool inside = path == name.from || path.starts_with(name.from + "/");
      moved.insert(inside ? name.to + path.substr(name.from.size()) : path);
    }
    disk->unsynced = std::move(moved);
    disk->names.push_back(std::move(name));
    return 0;
  }
  return Call(SYS_renameat2, AT_FDCWD, from, AT_FDCWD, to, flags);
}

}  // namespace

void Arm(const fs::path& root, Fault fault, int at) {
  Disarm();
  disk = new Disk{root.string() + "/", root.string() + ".replaced-", fault, at, 0, {}, {}};
}

int Disarm() {
  const int operations = disk == nullptr ? 0 : disk->operations;
  delete std::exchange(disk, nullptr);
  return operations;
}

void CutPower() {
  Disk* const lost = std::exchange(disk, nullptr);
  for (const std::string& path : lost->unsynced) {
    if (truncate(path.c_str(), 0) != 0 && errno != ENOENT) _exit(1);
  }
  if (lost->fault == Fault::kPowerCutNames) {
    std::error_code ignored;
    for (auto name = lost->names.rbegin(); name != lost->names.rend(); ++name) {
      if (name->from.empty()) {
        fs::remove_all(name->to, ignored);
      } else {
        fs::rename(name->to, name->from, ignored);
        if (!name->replaced.empty()) fs::rename(name->replaced, name->to, ignored);
      }
    }
  }
  _exit(kPowerCutStatus);
}

}  // namespace maneuver::durability

// NOLINTBEGIN: the names and types of the C library's.
using namespace maneuver::durability;

extern "C" {

int open(const char* file, int flags, ...) {
  mode_t mode = 0;
  if ((flags & O_CREAT) != 0) {
    va_list arguments;
    va_start(arguments, flags);
    mode = va_arg(arguments, mode_t);
    va_end(arguments);
  }
  const bool creates = (flags & O_CREAT) != 0 && Below(file);
  if (creates) {
    if (const int error = Begin(true); error != 0) return Result(-error);
  }
  const int descriptor = Call(SYS_openat, AT_FDCWD, file, flags, mode);
  if (creates && descriptor >= 0) {
    disk->names.push_back({"", file, ""});
    disk->unsynced.insert(file);
  }
  return descriptor;
}

ssize_t write(int descriptor, const void* bytes, size_t count) {
  const std::string path = disk == nullptr ? "" : PathOf(descriptor);
  if (Below(path)) {
    const bool fills = disk->fault == Fault::kFull && disk->operations == disk->at;
    const int error = Begin(true);
    disk->unsynced.insert(path);
    if (fills && count > 1) return syscall(SYS_write, descriptor, bytes, count / 2);
    if (error != 0) return Result(-error);
  }
  return syscall(SYS_write, descriptor, bytes, count);
}

int fsync(int descriptor) {
  const std::string path = disk == nullptr ? "" : PathOf(descriptor);
  if (Below(path + "/")) {
    if (const int error = Begin(false); error != 0) return Result(-error);
    disk->unsynced.erase(path);
    std::erase_if(disk->names, [&](const Name& name) { return ParentOf(name.to) == path; });
    return 0;  // this disk loses its power when it is told to
  }
  return Call(SYS_fsync, descriptor);
}

int rename(const char* from, const char* to) noexcept { return Rename(from, to, 0); }

int renameat2(int, const char* from, int, const char* to, unsigned flags) noexcept {
  return Rename(from, to, flags);
}

int link(const char* from, const char* to) noexcept {
  const bool below = Below(to);
  if (below) {
    if (const int error = Begin(true); error != 0) return Result(-error);
  }
  const int result = Call(SYS_linkat, AT_FDCWD, from, AT_FDCWD, to, 0);
  if (below && result == 0) disk->names.push_back({"", to, ""});
  return result;
}

int mkdir(const char* folder, mode_t mode) noexcept {
  const bool below = Below(folder);
  if (below) {
    if (const int error = Begin(true); error != 0) return Result(-error);
  }
  const int result = Call(SYS_mkdir, folder, mode);
  if (below && result == 0) disk->names.push_back({"", folder, ""});
  return result;
}

}  // extern "C"
// NOLINTEND
