#include "server/store/libpq.h"

#include <dlfcn.h>

#include <string>

#include "absl/strings/str_cat.h"

namespace maneuver::store {
namespace {

absl::StatusOr<Libpq> Load() {
  void* library = dlopen("libpq.so.5", RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    const char* reason = dlerror();
    return absl::FailedPreconditionError(
        absl::StrCat("--store postgresql:// needs PostgreSQL's client library; install the package "
                     "libpq5: ",
                     reason != nullptr ? reason : "it cannot be loaded"));
  }
  Libpq libpq;
  const char* missing = nullptr;
#define MANEUVER_FIND(function)                                                           \
  libpq.function = reinterpret_cast<decltype(libpq.function)>(dlsym(library, #function)); \
  if (libpq.function == nullptr) missing = #function;
  MANEUVER_LIBPQ_FUNCTIONS(MANEUVER_FIND)
#undef MANEUVER_FIND
  if (missing != nullptr) {
    return absl::FailedPreconditionError(
        absl::StrCat("libpq.so.5 has no ", missing, "; install libpq5 of PostgreSQL 15 or later"));
  }
  return libpq;
}

}  // namespace

absl::StatusOr<const Libpq*> LoadLibpq() {
  static const absl::StatusOr<Libpq> libpq = Load();
  if (!libpq.ok()) return libpq.status();
  return &*libpq;
}

}  // namespace maneuver::store
