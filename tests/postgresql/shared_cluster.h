// The cluster that all tests of a program share, and stores in it.

#ifndef MANEUVER_TESTS_POSTGRESQL_SHARED_CLUSTER_H_
#define MANEUVER_TESTS_POSTGRESQL_SHARED_CLUSTER_H_

#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/jobs/postgresql_schema.h"
#include "tests/postgresql/cluster.h"

namespace maneuver::postgresql {

// Ends the cluster when the program's tests are done.
class SharedCluster final : public testing::Environment {
 public:
  // Starts it on the first call.
  static absl::StatusOr<Cluster*> Get() {
    if (!started().ok() && started().status().message().empty()) started() = Cluster::Start();
    if (!started().ok()) return started().status();
    return started()->get();
  }
  void TearDown() override { started() = absl::NotFoundError("the tests are done"); }

 private:
  static absl::StatusOr<std::unique_ptr<Cluster>>& started() {
    static absl::StatusOr<std::unique_ptr<Cluster>> cluster = absl::UnknownError("");
    return cluster;
  }
};

inline const testing::Environment* const kSharedCluster =
    testing::AddGlobalTestEnvironment(new SharedCluster);

// Returns the URI of a new store with its tables.
inline absl::StatusOr<std::string> NewStoreAddress(Cluster& cluster) {
  std::string address = cluster.NewSchema();
  const auto connection = jobs::PostgresqlConnection::Open(address);
  if (!connection.ok()) return connection.status();
  const auto made = jobs::Migrate(**connection, jobs::StoreMigrations());
  if (!made.ok()) return made.status();
  return address;
}

}  // namespace maneuver::postgresql

#endif  // MANEUVER_TESTS_POSTGRESQL_SHARED_CLUSTER_H_
