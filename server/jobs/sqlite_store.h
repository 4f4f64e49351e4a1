// Jobs and aliases in one SQLite file.
//
// WAL with synchronous=FULL: a call that returned OK survives a power cut. The file is locked while
// it is open, so that no second server runs the same jobs. user_version is the schema's version.

#ifndef MANEUVER_SERVER_JOBS_SQLITE_STORE_H_
#define MANEUVER_SERVER_JOBS_SQLITE_STORE_H_

#include <filesystem>
#include <memory>

#include "absl/status/statusor.h"
#include "server/jobs/store.h"

namespace maneuver::jobs {

class SqliteStore : public Store {
 public:
  // Opens the file, or creates it. Migrates the tables of an earlier release. UNAVAILABLE if
  // another process has the file open, FAILED_PRECONDITION if a later release wrote it, DATA_LOSS
  // if it is damaged or not a database.
  static absl::StatusOr<std::unique_ptr<SqliteStore>> Open(const std::filesystem::path& file);
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_SQLITE_STORE_H_
