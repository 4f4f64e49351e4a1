#include "server/store/sqlite_statement.h"

#include <atomic>
#include <cerrno>
#include <chrono>

#include "absl/strings/str_cat.h"
#include "server/monitoring/logging.h"
#include "server/store/store_unavailable.h"

namespace maneuver::store {
namespace {

// Callers retry, and leave the log to the store: a line a minute is enough.
void LogFailure(const std::string& what) {
  constexpr std::chrono::minutes kBetweenLines{1};
  using Clock = std::chrono::steady_clock;
  static std::atomic<Clock::rep> next = Clock::time_point::min().time_since_epoch().count();
  const Clock::duration now = Clock::now().time_since_epoch();
  Clock::rep due = next.load();
  if (now.count() < due || !next.compare_exchange_strong(due, (now + kBetweenLines).count()))
    return;
  monitoring::Log(monitoring::LogLevel::kError, "the job store failed", {{"reason", what}});
}

absl::Status Unavailable(const std::string& what) {
  LogFailure(what);
  return StoreUnavailable(what);
}

}  // namespace

absl::Status SqliteError(sqlite3* database, int result) {
  const std::string what = database != nullptr ? sqlite3_errmsg(database) : sqlite3_errstr(result);
  const std::string reason = absl::StrCat("the job store: ", what);
  // Where SQLite cannot make a file of shared memory longer, it reports an error of the disk.
  if ((result & 0xff) == SQLITE_IOERR && database != nullptr &&
      (sqlite3_system_errno(database) == ENOSPC || sqlite3_system_errno(database) == EDQUOT)) {
    result = SQLITE_FULL;
  }
  switch (result & 0xff) {
    case SQLITE_FULL:
      return absl::ResourceExhaustedError(absl::StrCat(reason, "; free some disk space"));
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return Unavailable("another process uses it");
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return absl::DataLossError(reason);
    case SQLITE_CONSTRAINT:
      return absl::AlreadyExistsError(reason);
    default:
      return Unavailable(what);
  }
}

absl::Status Execute(sqlite3* database, const std::string& sql) {
  const int result = sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr);
  return result == SQLITE_OK ? absl::OkStatus() : SqliteError(database, result);
}

}  // namespace maneuver::store
