// Makes the disk of a program fail and its clock jump, from outside. The program is started with this
// library in LD_PRELOAD, and passes it on to the processes that it starts.
//
// MANEUVER_FAULTS names a file of four little-endian int64, which may change at any time:
//   [0] an errno: operations below the folder MANEUVER_FAULT_ROOT that would change the disk fail with it; with
//       ENOSPC only those that need room; -1: they never return; 0: none
//   [1] so many of them still succeed
//   [2] so many of them fail after that; the shim counts both down
//   [3] nanoseconds that are added to the time of day

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/futex.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

namespace {

struct Faults {
  int64_t error;
  int64_t succeed;
  int64_t fail;
  int64_t clock_offset_ns;
};

constexpr int64_t kSecond = 1'000'000'000;
// Later than any time since the start of a machine, and earlier than today: tells the clocks apart.
constexpr time_t kTimeOfDay = 1'000'000'000;

Faults none = {};
Faults* faults = &none;
char root[4096];
size_t root_length = 0;

template <typename Function>
Function Next(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}
#define NEXT(name) static const auto next = Next<decltype(&name)>(#name)

// Runs before main; until then nothing fails.
__attribute__((constructor)) void MapFaults() {
  const char* const file = getenv("MANEUVER_FAULTS");
  const char* const folder = getenv("MANEUVER_FAULT_ROOT");
  if (file == nullptr || folder == nullptr) return;
  root_length = static_cast<size_t>(snprintf(root, sizeof root, "%s/", folder));
  const int descriptor = static_cast<int>(syscall(SYS_openat, AT_FDCWD, file, O_RDWR | O_CLOEXEC));
  if (descriptor < 0) abort();
  void* const map =
      mmap(nullptr, sizeof(Faults), PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
  if (map == MAP_FAILED) abort();
  faults = static_cast<Faults*>(map);
  syscall(SYS_close, descriptor);
}

bool Armed() { return __atomic_load_n(&faults->error, __ATOMIC_RELAXED) != 0; }

bool Below(const char* path) { return path != nullptr && strncmp(path, root, root_length) == 0; }

// Returns whether the file of `descriptor` is below the folder, or is the folder.
bool Below(int descriptor) {
  char link[64];
  char path[4096];
  snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
  const ssize_t length = readlink(link, path, sizeof path - 2);
  if (length < 0) return false;
  path[length] = '/';
  path[length + 1] = '\0';
  return Below(path);
}

// Returns whether this operation fails, with errno set.
bool Fails(bool needs_room) {
  if (!needs_room && __atomic_load_n(&faults->error, __ATOMIC_RELAXED) == ENOSPC) return false;
  if (__atomic_fetch_sub(&faults->succeed, 1, __ATOMIC_RELAXED) > 0) return false;
  if (__atomic_fetch_sub(&faults->fail, 1, __ATOMIC_RELAXED) <= 0) return false;
  errno = static_cast<int>(__atomic_load_n(&faults->error, __ATOMIC_RELAXED));
  while (errno < 0) pause();
  return errno != 0;
}

template <typename Place>
bool Fails(Place place, bool needs_room = true) {
  return Armed() && Below(place) && Fails(needs_room);
}

timespec Shifted(const timespec& time, int64_t ns) {
  int64_t seconds = time.tv_sec + ns / kSecond;
  int64_t rest = time.tv_nsec + ns % kSecond;
  if (rest < 0) {
    rest += kSecond;
    --seconds;
  } else if (rest >= kSecond) {
    rest -= kSecond;
    ++seconds;
  }
  return {static_cast<time_t>(seconds), static_cast<long>(rest)};
}

int64_t ClockOffset() { return __atomic_load_n(&faults->clock_offset_ns, __ATOMIC_RELAXED); }

int Open(int folder, const char* file, int flags, mode_t mode) {
  if ((flags & O_CREAT) != 0 && Fails(file)) return -1;
  return static_cast<int>(syscall(SYS_openat, folder, file, flags, mode));
}

mode_t ModeOf(int flags, va_list arguments) {
  return (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(arguments, mode_t) : 0;
}

}  // namespace

// NOLINTBEGIN: the names and types of the C library's.
extern "C" {

#define OPEN(name)                                \
  int name(const char* file, int flags, ...) {    \
    va_list arguments;                            \
    va_start(arguments, flags);                   \
    const mode_t mode = ModeOf(flags, arguments); \
    va_end(arguments);                            \
    return Open(AT_FDCWD, file, flags, mode);     \
  }
#define OPENAT(name)                                       \
  int name(int folder, const char* file, int flags, ...) { \
    va_list arguments;                                     \
    va_start(arguments, flags);                            \
    const mode_t mode = ModeOf(flags, arguments);          \
    va_end(arguments);                                     \
    return Open(folder, file, flags, mode);                \
  }
OPEN(open)
OPEN(open64)
OPENAT(openat)
OPENAT(openat64)

ssize_t write(int descriptor, const void* bytes, size_t count) {
  if (Fails(descriptor)) return -1;
  return syscall(SYS_write, descriptor, bytes, count);
}
ssize_t writev(int descriptor, const iovec* parts, int count) {
  if (Fails(descriptor)) return -1;
  return syscall(SYS_writev, descriptor, parts, count);
}
ssize_t pwrite(int descriptor, const void* bytes, size_t count, off_t offset) {
  if (Fails(descriptor)) return -1;
  return syscall(SYS_pwrite64, descriptor, bytes, count, offset);
}
ssize_t pwrite64(int descriptor, const void* bytes, size_t count, off64_t offset) {
  if (Fails(descriptor)) return -1;
  return syscall(SYS_pwrite64, descriptor, bytes, count, offset);
}
int ftruncate(int descriptor, off_t size) noexcept {
  if (Fails(descriptor, false)) return -1;
  return static_cast<int>(syscall(SYS_ftruncate, descriptor, size));
}
int ftruncate64(int descriptor, off64_t size) noexcept {
  if (Fails(descriptor, false)) return -1;
  return static_cast<int>(syscall(SYS_ftruncate, descriptor, size));
}
int fsync(int descriptor) {
  if (Fails(descriptor, false)) return -1;
  return static_cast<int>(syscall(SYS_fsync, descriptor));
}
int fdatasync(int descriptor) {
  if (Fails(descriptor, false)) return -1;
  return static_cast<int>(syscall(SYS_fdatasync, descriptor));
}
int rename(const char* from, const char* to) noexcept {
  if (Fails(to, false)) return -1;
  return static_cast<int>(syscall(SYS_renameat2, AT_FDCWD, from, AT_FDCWD, to, 0));
}
int renameat2(int from_folder, const char* from, int to_folder, const char* to,
              unsigned flags) noexcept {
  if (Fails(to, false)) return -1;
  return static_cast<int>(syscall(SYS_renameat2, from_folder, from, to_folder, to, flags));
}
int link(const char* from, const char* to) noexcept {
  if (Fails(to)) return -1;
  return static_cast<int>(syscall(SYS_linkat, AT_FDCWD, from, AT_FDCWD, to, 0));
}
int mkdir(const char* folder, mode_t mode) noexcept {
  if (Fails(folder)) return -1;
  return static_cast<int>(syscall(SYS_mkdirat, AT_FDCWD, folder, mode));
}

int clock_gettime(clockid_t clock, timespec* time) noexcept {
  NEXT(clock_gettime);
  const int result = next(clock, time);
  if (result == 0 && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)) {
    *time = Shifted(*time, ClockOffset());
  }
  return result;
}
int gettimeofday(timeval* __restrict time, void* __restrict zone) noexcept {
  (void)zone;
  timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  *time = {now.tv_sec, static_cast<suseconds_t>(now.tv_nsec / 1000)};
  return 0;
}
time_t time(time_t* result) noexcept {
  timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  if (result != nullptr) *result = now.tv_sec;
  return now.tv_sec;
}

// The kernel knows nothing of the jump: who waits for a time of day means the shifted one.
int pthread_cond_timedwait(pthread_cond_t* __restrict condition, pthread_mutex_t* __restrict mutex,
                           const timespec* __restrict until) {
  NEXT(pthread_cond_timedwait);
  if (until->tv_sec < kTimeOfDay) return next(condition, mutex, until);
  const timespec shifted = Shifted(*until, -ClockOffset());
  return next(condition, mutex, &shifted);
}
long syscall(long number, ...) noexcept {
  static const auto next = Next<long (*)(long, ...)>("syscall");
  va_list arguments;
  va_start(arguments, number);
  long values[6];
  for (long& value : values) value = va_arg(arguments, long);
  va_end(arguments);
  timespec shifted;
  if (number == SYS_futex && (values[1] & FUTEX_CLOCK_REALTIME) != 0 && values[3] != 0) {
    shifted = Shifted(*reinterpret_cast<const timespec*>(values[3]), -ClockOffset());
    values[3] = reinterpret_cast<long>(&shifted);
  }
  return next(number, values[0], values[1], values[2], values[3], values[4], values[5]);
}

}  // extern "C"
// NOLINTEND
