#include "server/store/store_migration.h"

#include <algorithm>
#include <chrono>

#include "server/store/postgresql_connection.h"
#include "server/store/postgresql_schema.h"

namespace maneuver::store {
namespace {

constexpr std::chrono::seconds kMigrationPatience{3'600};

}  // namespace

absl::StatusOr<StoreMigration> MigrateStore(const std::string& address) {
  const auto connection = PostgresqlConnection::Open(address);
  if (!connection.ok()) return connection.status();
  const auto before = ReadSchemaVersion(**connection);
  if (!before.ok()) return before.status();
  const StoreUse use =
      IsAddition(*before, StoreMigrations()) ? StoreUse::kShared : StoreUse::kAlone;
  absl::Status status = LockStore(**connection, use, kPatienceForPredecessor);
  if (status.ok()) status = (*connection)->SetPatience(kMigrationPatience);
  if (!status.ok()) return status;
  const auto from = Migrate(**connection, StoreMigrations());
  if (!from.ok()) return from.status();
  return StoreMigration{from->latest,
                        std::max(from->latest, static_cast<int>(StoreMigrations().size()))};
}

}  // namespace maneuver::store
