// What a store asks of PostgreSQL stays cheap when there are 10,000 jobs, 1,000 versions and 1,000
// datasets.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <set>
#include <string>

#include "absl/strings/str_cat.h"
#include "server/store/postgresql_store.h"
#include "tests/postgresql/shared_cluster.h"
#include "tests/unit/server/store/store_suite.h"

namespace maneuver::store::query_plans_test {
namespace {

using security::ModelVersionName;

class QueryPlansTest : public postgresql::WithStore {
 protected:
  // Rows that no call below returns.
  void Fill() {
    const auto connection = PostgresqlConnection::Open(postgresql::AsTest(address_));
    ASSERT_TRUE(connection.ok()) << connection.status();
    ASSERT_TRUE((*connection)->SetPatience(std::chrono::minutes(2)).ok());
    const absl::Status filled =
        (*connection)
            ->RunScript(absl::StrCat(
                "INSERT INTO jobs (name, state, priority, create_time, request_id, request_digest, "
                "job)"
                " SELECT 'jobs/old' || i, CASE WHEN i % 10 = 0 THEN ",
                v1::JOB_STATE_FAILED, " ELSE ", v1::JOB_STATE_SUCCEEDED,
                " END, i % 5, i, decode(md5(i::text), 'hex'), '', '' FROM generate_series(1, "
                "10000) AS i;"
                "INSERT INTO progress SELECT number, s, '' FROM jobs, generate_series(1, 5) AS s;"
                "INSERT INTO versions SELECT 'old' || i % 50, i / 50, 1 FROM generate_series(1, "
                "1000) AS i;"
                "INSERT INTO versions SELECT 'old' || i % 50, i / 50, 2 FROM generate_series(1001, "
                "5000)"
                " AS i;"
                "INSERT INTO datasets SELECT 'old' || i, i, '' FROM generate_series(1, 1000) AS i;"
                " ANALYZE"));
    ASSERT_TRUE(filled.ok()) << filled;
  }

  // The life of two jobs.
  static void RunJobs(Store& store) {
    for (const char* id : {"a", "b", "c"}) {
      ASSERT_TRUE(store.Add(PendingJob(id), absl::StrCat("request-", id), "digest").ok());
    }
    ASSERT_TRUE(store.FindRequest("request-b").ok());
    ASSERT_TRUE(store.List(2, "").ok());
    ASSERT_TRUE(store.ListInState(v1::JOB_STATE_PENDING, std::nullopt).ok());
    ASSERT_TRUE(store.CountInState(v1::JOB_STATE_SUCCEEDED).ok());
    ASSERT_TRUE(store.Replicas()->Report(v1::Replica()).ok());
    ASSERT_TRUE(store.Replicas()->ListLive().ok());
    ASSERT_EQ(store.Replicas()->CountPendingNeeds()->size(), 1u);
    const auto claimed = store.Claim([](v1::Job&) {});
    ASSERT_TRUE(claimed.ok() && *claimed) << claimed.status();
    const jobs::JobLease lease = (*claimed)->lease;
    ASSERT_TRUE(store.Renew(lease).ok());
    ASSERT_TRUE(store.AddProgress(lease, Event(1)).ok());
    ASSERT_TRUE(store.ListProgress(lease.job, 0, 10).ok());
    ASSERT_TRUE(store.ListPositions({"jobs/a", "jobs/b", "jobs/unknown"}).ok());
    ASSERT_TRUE(store.RequestCancel(lease.job).ok());
    ASSERT_TRUE(store.TakeAbandoned(To(v1::JOB_STATE_PENDING)).ok());
    ASSERT_TRUE(store.Finish(lease, To(v1::JOB_STATE_CANCELLED)).ok());
    ASSERT_TRUE(store.Get(lease.job).ok());
    ASSERT_TRUE(
        store.Move(v1::JOB_STATE_PENDING, InState(*store.Get("jobs/b"), v1::JOB_STATE_CANCELLED))
            .ok());
    ASSERT_TRUE(store.Delete(lease.job).ok());
  }

  static void ChangeVersions(Store& store) {
    serving::VersionLedger& ledger = *store.Ledger();
    ASSERT_TRUE(ledger.Adopt({{"town", 1}}).ok());
    ASSERT_TRUE(ledger.AdoptDeleted({{"town", 2}}).ok());
    const auto number = ledger.Reserve("town", {});
    ASSERT_TRUE(number.ok()) << number.status();
    const ModelVersionName name{"town", *number};
    ASSERT_TRUE(ledger.Announce(name, {}).ok());
    ASSERT_TRUE(ledger.Change(name, {}, [] { return absl::OkStatus(); }).ok());
    for (int i = 0; i < 2; ++i) {
      ASSERT_TRUE(store.SetAlias({"town", "serving"}, i == 0 ? 1 : *number).ok());
    }
    ASSERT_TRUE(store.GetAlias({"town", "serving"}).ok());
    ASSERT_TRUE(store.ListAliases().ok());
    ASSERT_TRUE(store.DeleteAlias({"town", "serving"}).ok());
    ASSERT_TRUE(ledger.Retract(name).ok());
    ASSERT_EQ(ledger.ListVersions()->size(), 1001u);
  }

  static void ChangeDatasets(Store& store) {
    data::DatasetLedger& ledger = *store.Datasets();
    const auto folder_is_there = [] { return absl::OkStatus(); };
    v1::Dataset manifest;
    manifest.set_name("datasets/town");
    ASSERT_TRUE(ledger.Add(manifest, 1'000, folder_is_there).ok());
    ASSERT_TRUE(absl::IsAlreadyExists(ledger.Add(manifest, 1'000, folder_is_there)));
    ASSERT_TRUE(ledger.Get("town").ok());
    ASSERT_EQ(ledger.List("old5", 50)->size(), 50u);
    ASSERT_EQ(ledger.ListIds()->size(), 1001u);
    ASSERT_EQ(*ledger.TotalBytes(), 501'500);
    ASSERT_TRUE(ledger.Remove("town", folder_is_there).ok());
  }
};

TEST_F(QueryPlansTest, EachStatementReadsOnlyRowsThatItWants) {
  Fill();
  const size_t before = postgresql::ReadPlans(cluster_->log()).size();
  const auto store = PostgresqlStore::Share(address_);
  ASSERT_TRUE(store.ok()) << store.status();
  RunJobs(**store);
  ChangeVersions(**store);
  ChangeDatasets(**store);
  const auto plans = postgresql::ReadPlans(cluster_->log());
  std::set<std::string> statements;
  for (size_t i = before; i < plans.size(); ++i) {
    statements.insert(plans[i].statement);
    EXPECT_FALSE(postgresql::ReadsRowsInVain(plans[i])) << plans[i].statement << "\n"
                                                        << plans[i].steps;
  }
  // The log has them, so the test does not pass for want of plans.
  EXPECT_GT(statements.size(), 30u);
}

TEST_F(QueryPlansTest, AStatementWithoutAnIndexIsNoticed) {
  Fill();
  const auto connection = PostgresqlConnection::Open(postgresql::AsTest(address_));
  ASSERT_TRUE(connection.ok()) << connection.status();
  const auto steps_of = [&](const std::string& statement) {
    const auto rows = (*connection)->Run("EXPLAIN (ANALYZE, TIMING OFF) " + statement);
    EXPECT_TRUE(rows.ok()) << rows.status();
    postgresql::QueryPlan plan = {statement, ""};
    for (int row = 0; rows.ok() && row < rows->count(); ++row)
      plan.steps += rows->Bytes(row, 0) + "\n";
    return plan;
  };
  EXPECT_TRUE(ReadsRowsInVain(steps_of("SELECT number FROM jobs WHERE create_time = 5")));
  EXPECT_TRUE(ReadsRowsInVain(
      steps_of("SELECT job FROM jobs WHERE state = 3 AND job = 'x' ORDER BY priority DESC")));
  EXPECT_FALSE(ReadsRowsInVain(steps_of("SELECT number FROM jobs WHERE name = 'jobs/old1'")));
}

}  // namespace
}  // namespace maneuver::store::query_plans_test
