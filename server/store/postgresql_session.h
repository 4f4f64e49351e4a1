// The session of a server with its store in PostgreSQL. Private to the stores.

#ifndef MANEUVER_SERVER_STORE_POSTGRESQL_SESSION_H_
#define MANEUVER_SERVER_STORE_POSTGRESQL_SESSION_H_

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/monitoring/metrics.h"
#include "server/store/postgresql_connection.h"
#include "server/store/postgresql_schema.h"

namespace maneuver::store {

// Uses the store alone, or shares it with other servers that do. PostgreSQL holds a lock for the
// session. So no statement runs while another server uses the store in a way that this use forbids.
//
// If the connection is lost, the next call connects again and takes the lock again, but only once
// PostgreSQL has ended the old connection, whose statements could otherwise still arrive. If
// another server has used the store alone in between, what this server remembers is out of date:
// every call is UNAVAILABLE until the server starts again.
//
// Not thread-safe. Errors: those of PostgresqlConnection. For a second after a failure to connect,
// calls fail at once.
class PostgresqlSession {
 public:
  // Connects. FAILED_PRECONDITION if this release cannot use the tables (CheckSchema). UNAVAILABLE
  // if another server keeps the store for kPatienceForPredecessor.
  static absl::StatusOr<std::unique_ptr<PostgresqlSession>> Open(
      const std::string& address, StoreUse use, monitoring::MetricRegistry& metrics);

  // Returns the id of the store, which stays the same for ever.
  const std::string& store_id() const { return store_id_; }
  // Returns the id of this session, which no other one has ever had.
  const std::string& name() const { return name_; }

  // Runs a statement that changes nothing, a second time if the connection was lost.
  absl::StatusOr<SqlRows> Read(const SqlStatement& statement);

  // Runs `change` in a transaction and commits it if it returns OK.
  //
  // A connection that is lost during the commit leaves open whether the change was made. Then Write
  // fails, and the next connection first runs `undo`, which `change` may set: it must take the
  // change back if it was made, and do nothing if it was not or if others have built on it.
  using Change = std::function<absl::Status(PostgresqlConnection& connection, SqlStatement& undo)>;
  absl::Status Write(const Change& change);

 private:
  PostgresqlSession(std::string address, StoreUse use, monitoring::MetricRegistry& metrics);

  //   patience: how long to wait for another owner to go.
  absl::Status Connect(std::chrono::seconds patience);
  absl::Status EnsureConnected();
  // Sets the metric by the outcome of a call, and drops a broken connection.
  void Notice(const absl::Status& status);

  const std::string address_;
  const StoreUse use_;
  monitoring::Gauge& available_;
  std::unique_ptr<PostgresqlConnection> connection_;  // nullptr: lost
  absl::Status last_failure_;
  absl::Status last_refusal_;  // the last error of connecting that was logged
  std::chrono::steady_clock::time_point retry_at_;
  std::string store_id_;
  std::string name_;  // its own, by which a new connection waits for the end of the old one
  std::optional<int64_t> epoch_;  // number of this ownership; another in the store: we lost it
  std::optional<SqlStatement> undo_;
};

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_POSTGRESQL_SESSION_H_
