#include "server/store/postgresql_session.h"

#include <utility>

#include "server/monitoring/logging.h"
#include "server/store/store_unavailable.h"

namespace maneuver::store {
namespace {

using monitoring::Log;
using monitoring::LogLevel;

constexpr std::chrono::seconds kBetweenAttempts{1};
// Once this server serves, its callers do not wait.
constexpr std::chrono::seconds kNoPatience{0};

}  // namespace

PostgresqlSession::PostgresqlSession(std::string address, StoreUse use,
                                     monitoring::MetricRegistry& metrics)
    : address_(std::move(address)),
      use_(use),
      available_(metrics.AddGauge(
          "maneuver_store_available",
          "1 if the last call reached the database of --store, 0 if it did not.")) {}

absl::StatusOr<std::unique_ptr<PostgresqlSession>> PostgresqlSession::Open(
    const std::string& address, StoreUse use, monitoring::MetricRegistry& metrics) {
  std::unique_ptr<PostgresqlSession> session(new PostgresqlSession(address, use, metrics));
  if (absl::Status status = session->Connect(kPatienceForPredecessor); !status.ok()) return status;
  return session;
}

absl::Status PostgresqlSession::Connect(std::chrono::seconds patience) {
  auto connection = PostgresqlConnection::Open(address_);
  if (!connection.ok()) {
    if (!epoch_) return connection.status();
    // The log has the address; callers need not learn it.
    if (connection.status() != last_refusal_) {
      last_refusal_ = connection.status();
      Log(LogLevel::kWarning, "the database of --store cannot be reached",
          {{"reason", std::string(last_refusal_.message())}});
    }
    return StoreUnavailable("its database cannot be reached");
  }
  last_refusal_ = absl::OkStatus();
  if (absl::Status status = LockStore(**connection, use_, patience); !status.ok()) return status;
  if (absl::Status status = CheckSchema(**connection); !status.ok()) return status;
  if (!epoch_) {
    // An owner makes a new epoch; servers that share the store live in the last one.
    const auto taken = (*connection)
                           ->Run(use_ == StoreUse::kAlone
                                     ? "UPDATE store SET epoch = epoch + 1"
                                       " RETURNING epoch, id, gen_random_uuid()::text"
                                     : "SELECT epoch, id, gen_random_uuid()::text FROM store");
    if (!taken.ok()) return taken.status();
    name_ = taken->Bytes(0, 2);
    if (absl::Status status = LockName(**connection, name_, patience); !status.ok()) return status;
    epoch_ = taken->Int(0, 0);
    store_id_ = taken->Bytes(0, 1);
  } else {
    if (absl::Status status = LockName(**connection, name_, patience); !status.ok()) return status;
    const auto store = (*connection)->Run("SELECT epoch, id FROM store");
    if (!store.ok()) return store.status();
    if (store->Int(0, 0) != *epoch_ || store->Bytes(0, 1) != store_id_) {
      return StoreUnavailable(
          "another maneuverd has used this store since the connection was lost; start this one "
          "again");
    }
    if (undo_) {
      if (const auto undone = (*connection)->Run(*undo_); !undone.ok()) return undone.status();
      undo_.reset();
    }
  }
  connection_ = *std::move(connection);
  return absl::OkStatus();
}

void PostgresqlSession::Notice(const absl::Status& status) {
  const bool is_lost = connection_ == nullptr || connection_->is_broken();
  const bool was_lost = !last_failure_.ok();
  if (is_lost) {
    connection_ = nullptr;
    if (!was_lost) {
      Log(LogLevel::kError, "the database of --store is away",
          {{"reason", std::string(status.message())}});
    }
    last_failure_ = status;
  } else if (was_lost) {
    Log(LogLevel::kInfo, "the database of --store is back");
    last_failure_ = absl::OkStatus();
  }
  available_.Set(is_lost ? 0.0 : 1.0);
}

absl::Status PostgresqlSession::EnsureConnected() {
  if (connection_ != nullptr) return absl::OkStatus();
  if (std::chrono::steady_clock::now() < retry_at_) return last_failure_;
  absl::Status status = Connect(kNoPatience);
  if (!status.ok()) {
    retry_at_ = std::chrono::steady_clock::now() + kBetweenAttempts;
    Notice(status);
  }
  return status;
}

absl::StatusOr<SqlRows> PostgresqlSession::Read(const SqlStatement& statement) {
  for (bool is_retry = false;; is_retry = true) {
    if (absl::Status status = EnsureConnected(); !status.ok()) return status;
    auto rows = connection_->Run(statement);
    Notice(rows.status());
    if (rows.ok() || connection_ != nullptr || is_retry) return rows;
  }
}

absl::Status PostgresqlSession::Write(const Change& change) {
  // A connection that was lost while nobody used it shows here, where nothing is in doubt yet.
  if (const auto begun = Read({"BEGIN", {}}); !begun.ok()) return begun.status();
  SqlStatement undo;
  absl::Status status = change(*connection_, undo);
  if (!status.ok()) {
    if (!connection_->is_broken()) connection_->RunScript("ROLLBACK").IgnoreError();
    Notice(status);
    return status;
  }
  status = connection_->RunScript("COMMIT");
  if (connection_->is_broken() && !undo.text.empty()) undo_ = std::move(undo);
  Notice(status);
  return status;
}

}  // namespace maneuver::store
