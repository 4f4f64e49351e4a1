#include "server/store/postgresql_connection.h"

#include <poll.h>

#include <algorithm>
#include <cerrno>
#include <string_view>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "server/errors/error_details.h"
#include "server/store/store_address.h"
#include "server/store/store_unavailable.h"

namespace maneuver::store {
namespace {

// A database that fails over is back after some seconds.

// The first line of a message of libpq: the others give advice.
std::string FirstLine(const char* message) {
  const absl::string_view text = message == nullptr ? "" : message;
  return std::string(absl::StripAsciiWhitespace(text.substr(0, text.find('\n'))));
}

// Refuses an address with a password, whatever way of writing it libpq knows.
absl::Status CheckParsed(const Libpq& libpq, const std::string& address) {
  char* error = nullptr;
  PQconninfoOption* options = libpq.PQconninfoParse(address.c_str(), &error);
  if (options == nullptr) {
    const std::string reason = FirstLine(error);
    libpq.PQfreemem(error);
    return absl::InvalidArgumentError(absl::StrCat("--store: ", reason));
  }
  bool has_password = false;
  for (const PQconninfoOption* option = options; option->keyword != nullptr; ++option) {
    has_password |= absl::EndsWith(option->keyword, "password") && option->val != nullptr;
  }
  libpq.PQconninfoFree(options);
  return has_password
             ? absl::InvalidArgumentError("--store: the URI holds a password; use a password file")
             : absl::OkStatus();
}

}  // namespace

SqlValue SqlValue::Bytes(std::string bytes) {
  SqlValue value(std::move(bytes));
  value.is_binary_ = true;
  return value;
}

int64_t SqlRows::changed() const {
  int64_t changed = 0;
  return absl::SimpleAtoi(libpq_->PQcmdTuples(result_.get()), &changed) ? changed : 0;
}

int64_t SqlRows::Int(int row, int column) const {
  const std::string bytes = Bytes(row, column);
  uint64_t value = 0;
  for (const char byte : bytes) value = value << 8 | static_cast<unsigned char>(byte);
  return static_cast<int64_t>(value);
}

std::string SqlRows::Bytes(int row, int column) const {
  return {libpq_->PQgetvalue(result_.get(), row, column),
          static_cast<size_t>(libpq_->PQgetlength(result_.get(), row, column))};
}

absl::StatusOr<std::unique_ptr<PostgresqlConnection>> PostgresqlConnection::Open(
    const std::string& address) {
  if (absl::Status status = CheckStoreAddress(address); !status.ok()) return status;
  const auto loaded = LoadLibpq();
  if (!loaded.ok()) return loaded.status();
  const Libpq& libpq = **loaded;
  if (absl::Status status = CheckParsed(libpq, address); !status.ok()) return status;
  // The address comes last: it overrides the others. A host that does not answer, and a connection
  // that was cut, are noticed after 3 s each. Of several hosts the one that takes writes is meant.
  const char* const names[] = {"application_name",
                               "connect_timeout",
                               "tcp_user_timeout",
                               "keepalives_idle",
                               "keepalives_interval",
                               "keepalives_count",
                               "client_encoding",
                               "target_session_attrs",
                               "dbname",
                               nullptr};
  const char* const values[] = {"maneuverd", "3",          "3000",          "5",    "2", "3",
                                "UTF8",      "read-write", address.c_str(), nullptr};
  PGconn* connection = libpq.PQconnectdbParams(names, values, /*expand_dbname=*/1);
  std::unique_ptr<PostgresqlConnection> opened(new PostgresqlConnection(libpq, connection));
  if (libpq.PQstatus(connection) != CONNECTION_OK) {
    return StoreUnavailable(FirstLine(libpq.PQerrorMessage(connection)));
  }
  libpq.PQsetnonblocking(connection, 1);
  libpq.PQsetNoticeReceiver(
      connection, [](void*, const PGresult*) {}, nullptr);
  // The server ends a session whose client is gone, so that its lock does not stay. A commit that
  // is acknowledged has reached the disk. Each statement has an index, and uses it even where
  // statistics are missing or old. A scan of the one row of `store` then looks so costly that
  // PostgreSQL would compile it, which takes seconds on a busy machine.
  absl::Status status = opened->RunScript(
      "SET default_transaction_isolation = 'read committed';"
      "SET idle_in_transaction_session_timeout = '30s'; SET enable_seqscan = off; SET jit = off;"
      "SET tcp_keepalives_idle = 5; SET tcp_keepalives_interval = 2; SET tcp_keepalives_count = 3;"
      "SELECT set_config('synchronous_commit', 'on', false)"
      " WHERE current_setting('synchronous_commit') = 'off'");
  status.Update(opened->SetPatience(opened->patience_));
  if (!status.ok()) return status;
  return opened;
}

PostgresqlConnection::~PostgresqlConnection() { libpq_.PQfinish(connection_); }

absl::Status PostgresqlConnection::SetPatience(std::chrono::seconds patience) {
  patience_ = patience;
  return RunScript(absl::StrCat("SET statement_timeout = '", patience.count(), "s'"));
}

absl::Status PostgresqlConnection::Break(const std::string& why) {
  is_broken_ = true;
  return StoreUnavailable(why.empty() ? "the connection was lost" : why);
}

bool PostgresqlConnection::Wait(short events, Time deadline) const {
  for (;;) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
        deadline - std::chrono::steady_clock::now());
    pollfd socket = {libpq_.PQsocket(connection_), events, 0};
    const int ready = poll(&socket, 1, static_cast<int>(std::max<int64_t>(left.count(), 0)));
    if (ready > 0) return true;
    if (ready == 0 || errno != EINTR) return false;
  }
}

absl::StatusOr<bool> PostgresqlConnection::WaitForNotification(int stop) {
  bool is_notified = false;
  for (;;) {
    while (PGnotify* notification = libpq_.PQnotifies(connection_)) {
      libpq_.PQfreemem(notification);
      is_notified = true;
    }
    pollfd sockets[] = {{libpq_.PQsocket(connection_), POLLIN, 0}, {stop, POLLIN, 0}};
    // Those that have arrived meanwhile belong to the same.
    const int ready = poll(sockets, 2, /*timeout=*/is_notified ? 0 : -1);
    if (ready < 0) {
      if (errno == EINTR) continue;
      return Break("it cannot be waited for");
    }
    if (sockets[1].revents != 0) return false;
    if (ready == 0) return true;
    if (libpq_.PQconsumeInput(connection_) == 0) {
      return Break(FirstLine(libpq_.PQerrorMessage(connection_)));
    }
  }
}

absl::StatusOr<PostgresqlConnection::Result> PostgresqlConnection::Receive() {
  // The server's own limit comes first, unless it does not answer at all.
  const Time deadline = std::chrono::steady_clock::now() + patience_ + std::chrono::seconds(1);
  const auto failed = [this] { return Break(FirstLine(libpq_.PQerrorMessage(connection_))); };
  const auto silent = [this] {
    return Break(absl::StrCat("it has not answered for ", patience_.count() + 1, " s"));
  };
  for (;;) {
    const int left = libpq_.PQflush(connection_);
    if (left < 0) return failed();
    if (left == 0) break;
    if (!Wait(POLLIN | POLLOUT, deadline)) return silent();
    if (libpq_.PQconsumeInput(connection_) == 0) return failed();
  }
  Result kept(nullptr, libpq_.PQclear);
  for (;;) {
    while (libpq_.PQisBusy(connection_) != 0) {
      if (!Wait(POLLIN, deadline)) return silent();
      if (libpq_.PQconsumeInput(connection_) == 0) return failed();
    }
    Result result(libpq_.PQgetResult(connection_), libpq_.PQclear);
    if (result == nullptr) break;
    // Of a script that fails, the error is the last result.
    kept = std::move(result);
  }
  if (libpq_.PQstatus(connection_) != CONNECTION_OK || kept == nullptr) return failed();
  if (absl::Status status = ErrorOf(kept.get()); !status.ok()) return status;
  return kept;
}

absl::Status PostgresqlConnection::ErrorOf(const PGresult* result) {
  const ExecStatusType status = libpq_.PQresultStatus(result);
  if (status == PGRES_COMMAND_OK || status == PGRES_TUPLES_OK) return absl::OkStatus();
  const char* code_or_null = libpq_.PQresultErrorField(result, PG_DIAG_SQLSTATE);
  const std::string_view code = code_or_null == nullptr ? "" : code_or_null;
  // The primary message alone: details repeat values.
  const char* primary = libpq_.PQresultErrorField(result, PG_DIAG_MESSAGE_PRIMARY);
  const std::string message = FirstLine(primary);
  const std::string reason = absl::StrCat("the job store: ", message);
  if (code == "23505") return absl::AlreadyExistsError(reason);
  if (code == "53100") {
    return absl::ResourceExhaustedError(
        absl::StrCat(reason, "; free some disk space of the database"));
  }
  if (code.starts_with("XX")) return absl::DataLossError(reason);
  if (code == "42501" || code == "42P01" || code == "3F000") {
    return absl::FailedPreconditionError(reason);
  }
  if (code.starts_with("42")) return absl::InternalError(reason);  // a statement that is wrong
  // The host has become a standby: connect again, to the one that takes writes.
  if (code == "25006") return Break(message);
  return StoreUnavailable(message);
}

absl::StatusOr<SqlRows> PostgresqlConnection::Run(const SqlStatement& statement) {
  if (is_broken_) return StoreUnavailable("the connection was lost");
  std::vector<const char*> values;
  std::vector<int> sizes;
  std::vector<int> formats;
  for (const SqlValue& value : statement.values) {
    values.push_back(value.data());
    sizes.push_back(value.size());
    formats.push_back(value.is_binary() ? 1 : 0);
  }
  if (libpq_.PQsendQueryParams(connection_, statement.text.c_str(), static_cast<int>(values.size()),
                               nullptr, values.data(), sizes.data(), formats.data(),
                               /*resultFormat=*/1) == 0) {
    return Break(FirstLine(libpq_.PQerrorMessage(connection_)));
  }
  auto result = Receive();
  if (!result.ok()) return result.status();
  return SqlRows(libpq_, result->release());
}

absl::Status PostgresqlConnection::RunScript(const std::string& text) {
  if (is_broken_) return StoreUnavailable("the connection was lost");
  if (libpq_.PQsendQuery(connection_, text.c_str()) == 0) {
    return Break(FirstLine(libpq_.PQerrorMessage(connection_)));
  }
  return Receive().status();
}

}  // namespace maneuver::store
