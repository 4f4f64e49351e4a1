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

// Returns the scripts that make the tables of a store. Script i turns version i into version i + 1;
// in version 0 there are no tables. Released scripts never change.
const std::vector<std::string>& StoreMigrations();

// Returns the version of the tables; 0 if there are none. DATA_LOSS if the tables do not say it.
absl::StatusOr<int> SchemaVersion(PostgresqlConnection& connection);

// FAILED_PRECONDITION, with what to do, unless the tables have the latest version.
absl::Status CheckSchema(PostgresqlConnection& connection);

// Brings the tables from their version to the last of `migrations`, wholly or not at all, and
// returns the version that they had. FAILED_PRECONDITION if theirs is later.
absl::StatusOr<int> Migrate(PostgresqlConnection& connection,
                            const std::vector<std::string>& migrations);

// How long a starting server or command waits for the store's previous owner. By then PostgreSQL
// has noticed that the owner was stopped or killed, or that its connection was cut.
inline constexpr std::chrono::seconds kPatienceForPredecessor{15};

// How a server or a command uses a store.
enum class StoreUse {
  kAlone,  // no other may use it at the same time
  kShared  // others may, if they share it too
};

// Keeps other uses off the store, until the connection ends. UNAVAILABLE if one of them still has
// it after `patience`.
absl::Status LockStore(PostgresqlConnection& connection, StoreUse use,
                       std::chrono::seconds patience);

// Waits until an earlier connection with the same name has ended. UNAVAILABLE after `patience`.
absl::Status LockName(PostgresqlConnection& connection, const std::string& name,
                      std::chrono::seconds patience);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_POSTGRESQL_SCHEMA_H_
