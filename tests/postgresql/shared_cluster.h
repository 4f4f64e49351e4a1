// The cluster that all tests of a program share, and stores in it.

#ifndef MANEUVER_TESTS_POSTGRESQL_SHARED_CLUSTER_H_
#define MANEUVER_TESTS_POSTGRESQL_SHARED_CLUSTER_H_

#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/store/postgresql_schema.h"
#include "tests/postgresql/cluster.h"
#include "tests/postgresql/query_plans.h"

namespace maneuver::postgresql {

// Ends the cluster when the program's tests are done. Then expects that each statement of a store
// in any of them used an index (query_plans.h) and was not compiled.
class SharedCluster final : public testing::Environment {
 public:
  // Starts it on the first call.
  static absl::StatusOr<Cluster*> Get() {
    if (!started().ok() && started().status().message().empty())
      started() = Cluster::Start(/*explains=*/true);
    if (!started().ok()) return started().status();
    return started()->get();
  }
  void TearDown() override {
    if (started().ok()) {
      for (const QueryPlan& plan : ReadPlans((*started())->log())) {
        EXPECT_FALSE(ReadsRowsInVain(plan) || IsCompiled(plan)) << plan.statement << "\n"
                                                                << plan.steps;
      }
    }
    started() = absl::NotFoundError("the tests are done");
  }

 private:
  static absl::StatusOr<std::unique_ptr<Cluster>>& started() {
    static absl::StatusOr<std::unique_ptr<Cluster>> cluster = absl::UnknownError("");
    return cluster;
  }
};

inline const testing::Environment* const kSharedCluster =
    testing::AddGlobalTestEnvironment(new SharedCluster);

// Returns the URI for statements of a test itself, which need no index.
inline std::string AsTest(const std::string& address) { return address + "&application_name=test"; }

// Returns the URI of a new store with its tables.
inline absl::StatusOr<std::string> NewStoreAddress(Cluster& cluster) {
  std::string address = cluster.NewSchema();
  const auto connection = store::PostgresqlConnection::Open(address);
  if (!connection.ok()) return connection.status();
  const auto made = store::Migrate(**connection, store::StoreMigrations());
  if (!made.ok()) return made.status();
  return address;
}

// A test with a new store. Skipped where PostgreSQL is not installed. A SetUp of a derived class
// calls this one first, and returns if the test is skipped or has failed.
class WithStore : public testing::Test {
 protected:
  void SetUp() override {
    const auto cluster = SharedCluster::Get();
    if (absl::IsNotFound(cluster.status())) GTEST_SKIP() << cluster.status().message();
    ASSERT_TRUE(cluster.ok()) << cluster.status();
    cluster_ = *cluster;
    const auto address = NewStoreAddress(*cluster_);
    ASSERT_TRUE(address.ok()) << address.status();
    address_ = *address;
  }

  Cluster* cluster_ = nullptr;
  std::string address_;  // URI of the store
};

}  // namespace maneuver::postgresql

#endif  // MANEUVER_TESTS_POSTGRESQL_SHARED_CLUSTER_H_
