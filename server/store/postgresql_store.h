// Jobs, aliases, and lists of versions and datasets in a PostgreSQL database, version 15 or later.
//
// One server owns the store, or several share it (postgresql_session.h). Leases in a shared store
// end by the database's clock. Every change is one transaction, so a call that returned OK survives
// a crash of either side. `maneuverd store migrate` makes the tables and brings them up to date; a
// server never does.

#ifndef MANEUVER_SERVER_STORE_POSTGRESQL_STORE_H_
#define MANEUVER_SERVER_STORE_POSTGRESQL_STORE_H_

#include <chrono>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/monitoring/metrics.h"
#include "server/store/store.h"

namespace maneuver::store {

// How long after its Claim or Renew a lease in a store that is shared may be taken from its holder.
inline constexpr std::chrono::seconds kLeaseTime{15};

class PostgresqlStore : public Store {
 public:
  // Takes the store that is in the database of a URI (store_address.h). Waits for its previous
  // owner for at most kPatienceForPredecessor. FAILED_PRECONDITION if libpq is not installed or
  // this release cannot use the tables (CheckSchema), INVALID_ARGUMENT for a wrong URI, UNAVAILABLE
  // if the database cannot be reached or another server uses the store. `metrics` must outlive the
  // store.
  static absl::StatusOr<std::unique_ptr<PostgresqlStore>> Open(
      const std::string& address,
      monitoring::MetricRegistry& metrics = monitoring::MetricRegistry::Null());

  // Opens the store as Open does, beside other servers that share it. UNAVAILABLE if another server
  // owns it.
  static absl::StatusOr<std::unique_ptr<PostgresqlStore>> Share(
      const std::string& address,
      monitoring::MetricRegistry& metrics = monitoring::MetricRegistry::Null());

  // Returns the id of the store, which stays the same for ever.
  virtual const std::string& id() const = 0;
};

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_POSTGRESQL_STORE_H_
