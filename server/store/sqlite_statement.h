// SQLite's C interface as Status and values. Private to the store.

#ifndef MANEUVER_SERVER_STORE_SQLITE_STATEMENT_H_
#define MANEUVER_SERVER_STORE_SQLITE_STATEMENT_H_

#include <sqlite3.h>

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace maneuver::store {

// Returns the error for a result code of SQLite other than OK, ROW and DONE: RESOURCE_EXHAUSTED for
// a full disk, DATA_LOSS for a damaged file, ALREADY_EXISTS for a violated constraint,
// StoreUnavailable for any other, which is also logged, once a minute. The functions below return
// these errors.
//   database: adds SQLite's message; may be nullptr
absl::Status SqliteError(sqlite3* database, int result);

// Runs statements that return nothing.
absl::Status Execute(sqlite3* database, const std::string& sql);

// One prepared statement, run once. Bind fills its parameters from left to right. Text and bytes
// are not copied: they must outlive the statement.
class Statement {
 public:
  Statement(sqlite3* database, const char* sql) : database_(database) {
    result_ = sqlite3_prepare_v2(database, sql, -1, &statement_, nullptr);
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& Bind(int64_t value) {
    if (result_ == SQLITE_OK) result_ = sqlite3_bind_int64(statement_, ++bound_, value);
    return *this;
  }
  Statement& Bind(const std::string& text) {
    if (result_ == SQLITE_OK) {
      result_ = sqlite3_bind_text64(statement_, ++bound_, text.data(), text.size(), SQLITE_STATIC,
                                    SQLITE_UTF8);
    }
    return *this;
  }
  Statement& BindBlob(const std::string& bytes) {
    if (result_ == SQLITE_OK) {
      result_ =
          sqlite3_bind_blob64(statement_, ++bound_, bytes.data(), bytes.size(), SQLITE_STATIC);
    }
    return *this;
  }
  Statement& BindNull() {
    if (result_ == SQLITE_OK) result_ = sqlite3_bind_null(statement_, ++bound_);
    return *this;
  }

  // Reads the next row of the result. Returns false after the last one.
  absl::StatusOr<bool> Step() {
    if (result_ == SQLITE_OK || result_ == SQLITE_ROW) result_ = sqlite3_step(statement_);
    if (result_ == SQLITE_ROW) return true;
    if (result_ == SQLITE_DONE) return false;
    return SqliteError(database_, result_);
  }
  absl::Status Run() { return Step().status(); }

  int64_t Int(int column) const { return sqlite3_column_int64(statement_, column); }
  bool IsNull(int column) const { return sqlite3_column_type(statement_, column) == SQLITE_NULL; }
  std::string Bytes(int column) const {
    const void* data = sqlite3_column_blob(statement_, column);
    const int size = sqlite3_column_bytes(statement_, column);
    return data == nullptr ? std::string()
                           : std::string(static_cast<const char*>(data), static_cast<size_t>(size));
  }

 private:
  sqlite3* const database_;
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0;
  int result_;
};

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_SQLITE_STATEMENT_H_
