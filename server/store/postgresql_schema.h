// The tables of a store in PostgreSQL, and the steps from each version to the next. Private to the
// stores.

#ifndef MANEUVER_SERVER_STORE_POSTGRESQL_SCHEMA_H_
#define MANEUVER_SERVER_STORE_POSTGRESQL_SCHEMA_H_

#include <chrono>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/store/postgresql_connection.h"

namespace maneuver::store {

// A step from one version of the tables to the next.
struct SchemaStep {
  std::string script;
  // Servers that do not know the step may use the tables after it, and may be using them while it
  // is made: it adds a table, an index, or a column that they need not fill.
  bool is_addition = false;
};

// Returns the steps that make the tables of a store. Step i turns version i into version i + 1; in
// version 0 there are no tables. Released steps never change.
const std::vector<SchemaStep>& StoreMigrations();

struct SchemaVersion {
  int latest = 0;  // how many steps the tables have had; 0: there are none
  int needed = 0;  // how many of them a server has to know: those after it are additions

  bool operator==(const SchemaVersion&) const = default;
};

// Returns the version of the tables. DATA_LOSS if the tables do not say it.
absl::StatusOr<SchemaVersion> ReadSchemaVersion(PostgresqlConnection& connection);

// Returns OK if the tables have all steps of StoreMigrations and, beyond them, additions alone.
// Else FAILED_PRECONDITION says what to do.
absl::Status CheckSchema(PostgresqlConnection& connection);

// Brings the tables from their version to the last of `steps`, wholly or not at all, and returns
// the version that they had. FAILED_PRECONDITION if they have later steps that are not additions.
// Servers that share the store may be using it if IsAddition says so.
absl::StatusOr<SchemaVersion> Migrate(PostgresqlConnection& connection,
                                      const std::vector<SchemaStep>& steps);

// Returns whether the tables exist and the steps that they lack are additions.
bool IsAddition(const SchemaVersion& version, const std::vector<SchemaStep>& steps);

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

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_POSTGRESQL_SCHEMA_H_
