#include "server/store/sqlite_statement.h"

#include <cerrno>

#include "absl/strings/str_cat.h"

namespace maneuver::store {

absl::Status SqliteError(sqlite3* database, int result) {
  const std::string reason = absl::StrCat(
      "the job store: ", database != nullptr ? sqlite3_errmsg(database) : sqlite3_errstr(result));
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
      return absl::UnavailableError("the job store is in use by another process");
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return absl::DataLossError(reason);
    case SQLITE_CONSTRAINT:
      return absl::AlreadyExistsError(reason);
    default:
      return absl::UnavailableError(reason);
  }
}

absl::Status Execute(sqlite3* database, const std::string& sql) {
  const int result = sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr);
  return result == SQLITE_OK ? absl::OkStatus() : SqliteError(database, result);
}

}  // namespace maneuver::store
