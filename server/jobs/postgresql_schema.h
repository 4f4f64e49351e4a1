// The tables of a store in PostgreSQL, and the steps from each version to the next. Private to the
// stores.

#ifndef MANEUVER_SERVER_JOBS_POSTGRESQL_SCHEMA_H_
#define MANEUVER_SERVER_JOBS_POSTGRESQL_SCHEMA_H_

#include <chrono>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/jobs/postgresql_connection.h"

namespace maneuver::jobs {

// Returns the scripts that make a store: the first makes version 1 of nothing, each other one the
// next version of the one before. Released scripts never change.
const std::vector<std::string>& StoreMigrations();

// Returns the version of the tables; 0 if there are none.
absl::StatusOr<int> SchemaVersion(PostgresqlConnection& connection);

// FAILED_PRECONDITION, with what to do, unless the tables have the latest version.
absl::Status CheckSchema(PostgresqlConnection& connection);

// Brings the tables from their version to the last of `migrations`, wholly or not at all, and
// returns the version that they had. FAILED_PRECONDITION if theirs is later.
absl::StatusOr<int> Migrate(PostgresqlConnection& connection,
                            const std::vector<std::string>& migrations);

// How long a server or a command that starts waits for another owner: one that was just stopped or
// killed, or whose connection was cut, is gone by then.
inline constexpr std::chrono::seconds kPatienceForPredecessor{15};

// Keeps other servers and commands off the store, until the connection ends. UNAVAILABLE if one of
// them still has it after `patience`.
absl::Status LockStore(PostgresqlConnection& connection, std::chrono::seconds patience);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_POSTGRESQL_SCHEMA_H_
