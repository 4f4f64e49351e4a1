// A connection to PostgreSQL: statements with parameters, a limit to waiting, and errors as Status.
// Private to the stores.

#ifndef MANEUVER_SERVER_STORE_POSTGRESQL_CONNECTION_H_
#define MANEUVER_SERVER_STORE_POSTGRESQL_CONNECTION_H_

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/store/libpq.h"

namespace maneuver::store {

// A value of $1, $2, ... in a statement. Values never become part of its text.
class SqlValue {
 public:
  SqlValue(int64_t number) : bytes_(std::to_string(number)) {}  // NOLINT: a plain conversion
  SqlValue(std::string text) : bytes_(std::move(text)) {}       // NOLINT: a plain conversion
  static SqlValue Bytes(std::string bytes);
  static SqlValue Null() { return {}; }

  const char* data() const { return bytes_ ? bytes_->data() : nullptr; }
  int size() const { return bytes_ ? static_cast<int>(bytes_->size()) : 0; }
  bool is_binary() const { return is_binary_; }

 private:
  SqlValue() = default;

  std::optional<std::string> bytes_;  // nothing: NULL
  bool is_binary_ = false;
};

struct SqlStatement {
  std::string text;
  std::vector<SqlValue> values;
};

// The rows that a statement returned.
class SqlRows {
 public:
  SqlRows(const Libpq& libpq, PGresult* result) : libpq_(&libpq), result_(result, libpq.PQclear) {}

  int count() const { return libpq_->PQntuples(result_.get()); }
  bool empty() const { return count() == 0; }
  // Returns how many rows the statement inserted, changed or deleted.
  int64_t changed() const;

  bool IsNull(int row, int column) const {
    return libpq_->PQgetisnull(result_.get(), row, column) != 0;
  }
  // Returns a value of type int8 or, as 0 or 1, boolean.
  int64_t Int(int row, int column) const;
  // Returns a value of type text or bytea.
  std::string Bytes(int row, int column) const;

 private:
  const Libpq* libpq_;
  std::unique_ptr<PGresult, void (*)(PGresult*)> result_;
};

// Not thread-safe. Errors: RESOURCE_EXHAUSTED for a full disk, ALREADY_EXISTS for a second row with
// a unique key, DATA_LOSS for damage, FAILED_PRECONDITION for a missing permission or table,
// INTERNAL for a statement that PostgreSQL does not understand; StoreUnavailable
// (store_unavailable.h) for all else.
class PostgresqlConnection {
 public:
  // Connects. INVALID_ARGUMENT for an address that libpq does not understand or that holds a
  // password; FAILED_PRECONDITION if libpq is not installed.
  static absl::StatusOr<std::unique_ptr<PostgresqlConnection>> Open(const std::string& address);
  ~PostgresqlConnection();
  PostgresqlConnection(const PostgresqlConnection&) = delete;
  PostgresqlConnection& operator=(const PostgresqlConnection&) = delete;

  // Runs one statement.
  absl::StatusOr<SqlRows> Run(const SqlStatement& statement);
  absl::StatusOr<SqlRows> Run(std::string text, std::vector<SqlValue> values = {}) {
    return Run(SqlStatement{std::move(text), std::move(values)});
  }
  // Runs several statements without values, separated by semicolons.
  absl::Status RunScript(const std::string& text);

  // Waits until PostgreSQL tells of a NOTIFY on a channel that the connection LISTENs to, and
  // returns true. It then forgets all that have arrived. Returns false once the descriptor `stop`
  // can be read.
  absl::StatusOr<bool> WaitForNotification(int stop);

  // Returns whether the connection is gone: open another one.
  bool is_broken() const { return is_broken_; }

  // Sets how long one statement may take; 5 s at first.
  absl::Status SetPatience(std::chrono::seconds patience);

 private:
  using Time = std::chrono::steady_clock::time_point;
  using Result = std::unique_ptr<PGresult, void (*)(PGresult*)>;

  PostgresqlConnection(const Libpq& libpq, PGconn* connection)
      : libpq_(libpq), connection_(connection) {}

  absl::Status Break(const std::string& why);
  bool Wait(short events, Time deadline) const;
  absl::StatusOr<Result> Receive();
  absl::Status ErrorOf(const PGresult* result);

  const Libpq& libpq_;
  PGconn* const connection_;
  std::chrono::seconds patience_{5};
  bool is_broken_ = false;
};

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_POSTGRESQL_CONNECTION_H_
