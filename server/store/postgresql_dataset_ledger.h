// The list of datasets in a store in PostgreSQL. Private to the stores.

#ifndef MANEUVER_SERVER_STORE_POSTGRESQL_DATASET_LEDGER_H_
#define MANEUVER_SERVER_STORE_POSTGRESQL_DATASET_LEDGER_H_

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/data/dataset_ledger.h"
#include "server/store/postgresql_connection.h"
#include "server/store/postgresql_session.h"

namespace maneuver::store {

// Each Add and Remove is one transaction, which holds the row while the folder is moved. Another
// server that adds or removes the same dataset waits for its end, for 1 s at most; then its call is
// UNAVAILABLE. The session waits, too: a folder that hangs would keep the store from its other
// callers, so callers first write beside the folder. PostgreSQL ends the transaction of a server
// that was frozen after 30 s.
//
// If the connection is lost during the commit, nothing is taken back, because the folder has moved:
// after Add the folder is whole, and a server that finds it without a row adds it; after Remove a
// row may be left, which the next Remove deletes.
class PostgresqlDatasetLedger final : public data::DatasetLedger {
 public:
  // Run one statement and one transaction of the store's session.
  using Read = std::function<absl::StatusOr<SqlRows>(const SqlStatement&)>;
  using Write = std::function<absl::Status(const PostgresqlSession::Change&)>;

  PostgresqlDatasetLedger(Read read, Write write);

  absl::StatusOr<std::vector<v1::Dataset>> List(const std::string& after, size_t limit) override;
  absl::StatusOr<std::vector<std::string>> ListIds() override;
  absl::StatusOr<v1::Dataset> Get(const std::string& id) override;
  absl::StatusOr<int64_t> TotalBytes() override;
  absl::Status Add(const v1::Dataset& manifest, int64_t bytes,
                   const std::function<absl::Status()>& publish) override;
  absl::Status Remove(const std::string& id, const std::function<absl::Status()>& remove) override;

 private:
  const Read read_;
  const Write write_;
};

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_POSTGRESQL_DATASET_LEDGER_H_
