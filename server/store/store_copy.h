// Brings jobs and aliases from the embedded store of a data folder into PostgreSQL. The first
// server over it adds the folder's versions and datasets to their ledgers.

#ifndef MANEUVER_SERVER_STORE_STORE_COPY_H_
#define MANEUVER_SERVER_STORE_STORE_COPY_H_

#include <filesystem>
#include <string>

#include "absl/status/statusor.h"
#include "server/store/store_check.h"

namespace maneuver::store {

// Copies every row in one transaction, reads both stores whole and compares what they hold. Then
// the data folder belongs to the store in PostgreSQL, and maneuver.db is maneuver.db.copied. The
// caller holds the lock of the folder.
//
// A copy that was cut off is continued by another call. NOT_FOUND if the folder has no embedded
// store; FAILED_PRECONDITION if the database already holds jobs, aliases or datasets, or this
// release cannot use its tables (CheckSchema); UNAVAILABLE if another process holds the database,
// or it cannot be reached; DATA_LOSS if a row is damaged, or the stores differ in the end.
absl::StatusOr<StoreContents> CopyStore(const std::filesystem::path& data_dir,
                                        const std::string& address);

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_STORE_COPY_H_
