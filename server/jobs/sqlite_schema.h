// The tables of the store, and how those of earlier servers become them. Private to the store.

#ifndef MANEUVER_SERVER_JOBS_SQLITE_SCHEMA_H_
#define MANEUVER_SERVER_JOBS_SQLITE_SCHEMA_H_

#include <sqlite3.h>

#include "absl/status/status.h"

namespace maneuver::jobs {

// Creates the tables, or brings those of an earlier version up to this one: wholly or not at all.
// FAILED_PRECONDITION for a later version.
absl::Status PrepareSchema(sqlite3* database);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_SQLITE_SCHEMA_H_
