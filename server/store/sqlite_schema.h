// Creates and migrates the tables of the store. Private to the store.

#ifndef MANEUVER_SERVER_STORE_SQLITE_SCHEMA_H_
#define MANEUVER_SERVER_STORE_SQLITE_SCHEMA_H_

#include <sqlite3.h>

#include "absl/status/status.h"

namespace maneuver::store {

// Creates the tables, or migrates those of an earlier release. Either all of it happens or nothing.
// FAILED_PRECONDITION if a later release wrote the tables; other errors: those of SqliteError.
absl::Status PrepareSchema(sqlite3* database);

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_SQLITE_SCHEMA_H_
