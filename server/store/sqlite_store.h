// Jobs and aliases in one SQLite file.
//
// WAL with synchronous=FULL: a call that returned OK survives a power cut. Each change is brought into
// the file at once, so that the journal holds nothing that the file lacks, unless somebody reads or
// the power fails just then. A back-up may read the file while it is open; the lock of the data folder, not of the file, keeps a second server off.
// user_version is the schema's version.

#ifndef MANEUVER_SERVER_STORE_SQLITE_STORE_H_
#define MANEUVER_SERVER_STORE_SQLITE_STORE_H_

#include <filesystem>
#include <memory>

#include "absl/status/statusor.h"
#include "server/store/store.h"

namespace maneuver::store {

class SqliteStore : public Store {
 public:
  // Opens the file, or creates it. Reads all of it to find damage, and migrates the tables of an
  // earlier release. UNAVAILABLE if another process writes to it for longer than a second or it
  // cannot be opened, FAILED_PRECONDITION if a later release wrote it, DATA_LOSS if it is damaged
  // or not a database.
  static absl::StatusOr<std::unique_ptr<SqliteStore>> Open(const std::filesystem::path& file);
};

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_SQLITE_STORE_H_
