#include "server/jobs/store_migration.h"

#include <chrono>

#include "server/jobs/postgresql_connection.h"
#include "server/jobs/postgresql_schema.h"

namespace maneuver::jobs {
namespace {

constexpr std::chrono::seconds kMigrationPatience{3'600};

}  // namespace

absl::StatusOr<StoreMigration> MigrateStore(const std::string& address) {
  const auto connection = PostgresqlConnection::Open(address);
  if (!connection.ok()) return connection.status();
  absl::Status status = LockStore(**connection, StoreUse::kAlone, kPatienceForPredecessor);
  if (status.ok()) status = (*connection)->SetPatience(kMigrationPatience);
  if (!status.ok()) return status;
  const auto from = Migrate(**connection, StoreMigrations());
  if (!from.ok()) return from.status();
  return StoreMigration{*from, static_cast<int>(StoreMigrations().size())};
}

}  // namespace maneuver::jobs
