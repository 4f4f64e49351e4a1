// Makes the tables of a store in PostgreSQL, or brings them up to date.

#ifndef MANEUVER_SERVER_STORE_STORE_MIGRATION_H_
#define MANEUVER_SERVER_STORE_STORE_MIGRATION_H_

#include <string>

#include "absl/status/statusor.h"

namespace maneuver::store {

struct StoreMigration {
  int from = 0;  // the schema's version before; 0: there were no tables
  int to = 0;    // the schema's version now
};

// Brings the tables in the database of `address` to the latest version, wholly or not at all.
// FAILED_PRECONDITION if they have later steps that are not additions (SchemaStep). UNAVAILABLE if
// a server uses the store, unless it shares it and the tables lack additions alone.
absl::StatusOr<StoreMigration> MigrateStore(const std::string& address);

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_STORE_MIGRATION_H_
