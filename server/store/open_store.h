// Finds the store of a data folder.

#ifndef MANEUVER_SERVER_STORE_OPEN_STORE_H_
#define MANEUVER_SERVER_STORE_OPEN_STORE_H_

#include <filesystem>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/monitoring/metrics.h"
#include "server/store/store.h"

namespace maneuver::store {

// Files in a data folder.
inline constexpr char kEmbeddedStore[] = "maneuver.db";
inline constexpr char kCopiedStore[] = "maneuver.db.copied";  // it, after its copy to PostgreSQL
inline constexpr char kStoreId[] = "store-id";  // the id of the folder's store in PostgreSQL

// Opens the store of a data folder, whose lock the caller holds: the embedded one, or the one in
// PostgreSQL that `address` names, to which the folder belongs from then on.
//   is_shared: other servers use folder and store, too; needs an address
//
// A store that lacks the folder's jobs would cost them their checkpoints, because a server removes
// the folders of unknown jobs. So FAILED_PRECONDITION if the folder belongs to another store. Other
// errors: those of SqliteStore::Open and PostgresqlStore::Open. `metrics` must outlive the store.
absl::StatusOr<std::unique_ptr<Store>> OpenStore(
    const std::filesystem::path& data_dir, const std::string& address, bool is_shared = false,
    monitoring::MetricRegistry& metrics = monitoring::MetricRegistry::Null());

// Returns the id of the store in PostgreSQL that a data folder belongs to; empty if it belongs to
// none.
absl::StatusOr<std::string> StoreIdOf(const std::filesystem::path& data_dir);
// Makes the data folder belong to the store with this id.
absl::Status WriteStoreId(const std::filesystem::path& data_dir, const std::string& id);

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_OPEN_STORE_H_
