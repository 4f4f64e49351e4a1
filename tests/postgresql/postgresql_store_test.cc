#include "server/store/postgresql_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "server/errors/error_details.h"
#include "server/store/postgresql_schema.h"
#include "server/store/stored_job.h"
#include "tests/postgresql/lossy_proxy.h"
#include "tests/postgresql/shared_cluster.h"
#include "tests/unit/server/store/store_suite.h"

namespace maneuver::store::postgresql_store_test {
namespace {

using postgresql::LossyProxy;
using postgresql::NewStoreAddress;
using postgresql::SharedCluster;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

class PostgresqlMaker final : public StoreMaker {
 public:
  explicit PostgresqlMaker(std::string address) : address_(std::move(address)) {}
  absl::StatusOr<std::unique_ptr<Store>> Open() override {
    auto store = PostgresqlStore::Open(address_);
    if (!store.ok()) return store.status();
    return *std::move(store);
  }
  absl::Status Run(const std::string& statement) override {
    const auto connection = PostgresqlConnection::Open(postgresql::AsTest(address_));
    if (!connection.ok()) return connection.status();
    return (*connection)->Run(statement).status();
  }

 private:
  const std::string address_;
};

absl::StatusOr<std::unique_ptr<StoreMaker>> NewPostgresqlStore(const std::filesystem::path&) {
  const auto cluster = SharedCluster::Get();
  if (!cluster.ok()) return cluster.status();
  const auto address = NewStoreAddress(**cluster);
  if (!address.ok()) return address.status();
  return std::make_unique<PostgresqlMaker>(*address);
}

class PostgresqlStoreTest : public postgresql::WithStore {
 protected:
  std::unique_ptr<PostgresqlStore> Open(const std::string& address) {
    auto store = PostgresqlStore::Open(address);
    EXPECT_TRUE(store.ok()) << store.status();
    return store.ok() ? *std::move(store) : nullptr;
  }
  std::unique_ptr<PostgresqlConnection> Connect(const std::string& address) {
    auto connection = PostgresqlConnection::Open(postgresql::AsTest(address));
    EXPECT_TRUE(connection.ok()) << connection.status();
    return connection.ok() ? *std::move(connection) : nullptr;
  }

  // Calls until the store is back: it tries to connect once a second.
  static absl::Status Eventually(const std::function<absl::Status()>& call) {
    absl::Status status;
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (std::chrono::steady_clock::now() < deadline) {
      status = call();
      if (!errors::IsStoreAway(status)) return status;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    return status;
  }
};

TEST_F(PostgresqlStoreTest, AStoreHasOneOwner) {
  const auto store = Open(address_);
  const auto other = Connect(address_);
  const absl::Status refused = LockStore(*other, StoreUse::kAlone, std::chrono::seconds(0));
  EXPECT_TRUE(errors::IsStoreAway(refused)) << refused;
  EXPECT_THAT(std::string(refused.message()), HasSubstr("another maneuverd uses this store"));
}

TEST_F(PostgresqlStoreTest, ADatabaseWithoutTablesIsRefusedWithTheCommandThatMakesThem) {
  const auto store = PostgresqlStore::Open(cluster_->NewSchema());
  EXPECT_TRUE(absl::IsFailedPrecondition(store.status())) << store.status();
  EXPECT_THAT(std::string(store.status().message()), HasSubstr("maneuverd store migrate"));
}

TEST_F(PostgresqlStoreTest, ALaterSchemaIsRefused) {
  ASSERT_TRUE(Connect(address_)->RunScript("UPDATE store SET schema_version = 99").ok());
  const auto store = PostgresqlStore::Open(address_);
  EXPECT_TRUE(absl::IsFailedPrecondition(store.status())) << store.status();
  EXPECT_THAT(std::string(store.status().message()), HasSubstr("version 99"));
  const auto migrated = Migrate(*Connect(address_), StoreMigrations());
  EXPECT_TRUE(absl::IsFailedPrecondition(migrated.status())) << migrated.status();
}

TEST_F(PostgresqlStoreTest, AnEarlierSchemaIsRefusedUntilItIsMigrated) {
  std::vector<SchemaStep> migrations = StoreMigrations();
  const auto latest = static_cast<int>(migrations.size());
  migrations.push_back({"ALTER TABLE jobs ADD COLUMN colour TEXT NOT NULL DEFAULT 'blue'"});
  ASSERT_TRUE(Open(address_)->Add(PendingJob("a"), "", "").ok());
  // As it looks to a release that knows the next version.
  ASSERT_TRUE(Connect(address_)->RunScript("UPDATE store SET latest_version = 0").ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(PostgresqlStore::Open(address_).status()));
  ASSERT_TRUE(
      Connect(address_)->Run("UPDATE store SET latest_version = $1", {int64_t{latest}}).ok());

  const auto from = Migrate(*Connect(address_), migrations);
  ASSERT_TRUE(from.ok()) << from.status();
  EXPECT_EQ(from->latest, latest);
  EXPECT_EQ(*ReadSchemaVersion(*Connect(address_)), (SchemaVersion{latest + 1, latest + 1}));
  // This release does not know the new tables.
  EXPECT_TRUE(absl::IsFailedPrecondition(PostgresqlStore::Share(address_).status()));
  const auto job = Connect(address_)->Run("SELECT name FROM jobs WHERE colour = 'blue'");
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->Bytes(0, 0), "jobs/a");
}

TEST_F(PostgresqlStoreTest, AMigrationThatFailsChangesNothing) {
  std::vector<SchemaStep> migrations = StoreMigrations();
  migrations.push_back({"CREATE TABLE half (a INT); CREATE TABLE half (a INT)"});
  EXPECT_FALSE(Migrate(*Connect(address_), migrations).ok());
  EXPECT_EQ(ReadSchemaVersion(*Connect(address_))->latest,
            static_cast<int>(StoreMigrations().size()));
  EXPECT_FALSE(Connect(address_)->Run("SELECT a FROM half").ok());
}

TEST_F(PostgresqlStoreTest, ARestartOfTheDatabaseThatNobodyNoticedFailsNoCall) {
  const auto store = Open(address_);
  ASSERT_TRUE(store->Add(PendingJob("a"), "", "").ok());
  cluster_->Stop(SIGINT);
  ASSERT_TRUE(cluster_->Resume().ok());
  EXPECT_TRUE(store->Get("jobs/a").ok());
  cluster_->Stop(SIGQUIT);
  ASSERT_TRUE(cluster_->Resume().ok());
  EXPECT_TRUE(store->SetAlias({"town", "serving"}, 2).ok());
  EXPECT_EQ(*store->GetAlias({"town", "serving"}), 2);
}

TEST_F(PostgresqlStoreTest, CallsFailAtOnceWhileTheDatabaseIsAwayAndLeasesStay) {
  const auto store = Open(address_);
  ASSERT_TRUE(store->Add(PendingJob("a"), "", "").ok());
  const auto claimed = store->Claim([](v1::Job&) {});
  ASSERT_TRUE(claimed.ok() && *claimed) << claimed.status();
  cluster_->Stop(SIGQUIT);
  for (int i = 0; i < 20; ++i) {
    const absl::Status away = store->Get("jobs/a").status();
    EXPECT_TRUE(errors::IsStoreAway(away)) << away;
    EXPECT_EQ(away.code(), absl::StatusCode::kUnavailable);
    EXPECT_TRUE(errors::RetryDelay(away).has_value());
    EXPECT_THAT(std::string(away.message()), Not(HasSubstr(cluster_->password())));
    EXPECT_THAT(std::string(away.message()), Not(HasSubstr("PGSQL")));  // the address
  }
  EXPECT_TRUE(errors::IsStoreAway(store->AddProgress((*claimed)->lease, Event(1))));
  ASSERT_TRUE(cluster_->Resume().ok());
  EXPECT_TRUE(Eventually([&] { return store->AddProgress((*claimed)->lease, Event(1)); }).ok());
  EXPECT_TRUE(store->Finish((*claimed)->lease, To(v1::JOB_STATE_SUCCEEDED)).ok());
}

TEST_F(PostgresqlStoreTest, ADatabaseThatHangsDoesNotHangItsCallers) {
  const auto store = Open(address_);
  // The backend, not the whole cluster: the next connection is another one.
  const auto backend = Connect(address_)->Run(
      "SELECT pid::int8 FROM pg_stat_activity WHERE query LIKE '%job_fences%'"
      " AND pid <> pg_backend_pid()");
  ASSERT_TRUE(backend.ok() && !backend->empty()) << backend.status();
  const auto pid = static_cast<pid_t>(backend->Int(0, 0));
  kill(pid, SIGSTOP);
  const auto before = std::chrono::steady_clock::now();
  const absl::Status status = store->SetAlias({"town", "serving"}, 1);
  EXPECT_TRUE(errors::IsStoreAway(status)) << status;
  EXPECT_LT(std::chrono::steady_clock::now() - before, std::chrono::seconds(15));
  // The frozen session still holds the lock, so that nothing of it can come after what follows.
  EXPECT_TRUE(errors::IsStoreAway(store->Get("jobs/a").status()));
  kill(pid, SIGCONT);
  EXPECT_TRUE(Eventually([&] { return store->SetAlias({"town", "serving"}, 2); }).ok());
  EXPECT_EQ(*store->GetAlias({"town", "serving"}), 2);
}

TEST_F(PostgresqlStoreTest, AServerWhoseStoreAnotherOneHadStops) {
  const auto store = Open(address_);
  ASSERT_TRUE(store->SetAlias({"town", "serving"}, 1).ok());
  {
    const auto end = Connect(address_)->Run(
        "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid()"
        " AND application_name = 'maneuverd'");
    ASSERT_TRUE(end.ok()) << end.status();
    const auto other = Open(address_);
    ASSERT_TRUE(other->SetAlias({"town", "serving"}, 2).ok());
  }
  for (int i = 0; i < 3; ++i) {
    const absl::Status refused = store->SetAlias({"town", "serving"}, 3);
    EXPECT_TRUE(errors::IsStoreAway(refused)) << refused;
    EXPECT_THAT(std::string(refused.message()), HasSubstr("another maneuverd"));
  }
  EXPECT_EQ(*Open(address_)->GetAlias({"town", "serving"}), 2);
}

TEST_F(PostgresqlStoreTest, ValuesNeverBecomePartOfAStatement) {
  const auto store = Open(address_);
  const std::string evil = "'; DROP TABLE jobs; --";
  const std::string zero("with\0zero", 9);
  ASSERT_TRUE(store->Add(PendingJob("a"), evil, evil).ok());
  ASSERT_TRUE(store->Add(PendingJob("b"), zero, "").ok());
  EXPECT_EQ((*store->FindRequest(evil))->job.name(), "jobs/a");
  EXPECT_EQ((*store->FindRequest(evil))->request_digest, evil);
  EXPECT_EQ((*store->FindRequest(zero))->job.name(), "jobs/b");
  EXPECT_FALSE(store->FindRequest("with")->has_value());
  EXPECT_TRUE(absl::IsNotFound(store->Get(evil).status()));
  EXPECT_TRUE(absl::IsNotFound(store->GetAlias({evil, evil}).status()));
}

TEST_F(PostgresqlStoreTest, ADamagedRowIsNamedAndNotUsed) {
  const auto store = Open(address_);
  ASSERT_TRUE(store->Add(PendingJob("a"), "", "").ok());
  ASSERT_TRUE(store->SetAlias({"town", "serving"}, 1).ok());
  ASSERT_TRUE(Connect(address_)
                  ->RunScript("UPDATE jobs SET job = set_byte(job, 3, get_byte(job, 3) # 1);"
                              "UPDATE aliases SET version = 7")
                  .ok());
  EXPECT_TRUE(absl::IsDataLoss(store->Get("jobs/a").status()));
  EXPECT_TRUE(absl::IsDataLoss(store->GetAlias({"town", "serving"}).status()));
}

TEST_F(PostgresqlStoreTest, APasswordInTheAddressIsRefusedAndNotRepeated) {
  for (const std::string address :
       {"postgresql://maneuver:hunter2@/postgres", "postgresql:///postgres?password=hunter2",
        "postgresql:///postgres?p%61ssword=hunter2", "postgresql:///postgres?sslpassword=hunter2",
        "postgres://maneuver:hunter2@a.example,b.example/postgres"}) {
    const absl::Status refused = PostgresqlConnection::Open(address).status();
    EXPECT_TRUE(absl::IsInvalidArgument(refused)) << address << ": " << refused;
    EXPECT_THAT(std::string(refused.message()), Not(HasSubstr("hunter2")));
  }
}

// Prints how long a call takes. A machine with other work takes any time, so nothing is expected.
void Time(const char* what, const std::function<absl::Status()>& call) {
  std::vector<double> milliseconds;
  for (int i = 0; i < 100; ++i) {
    const auto before = std::chrono::steady_clock::now();
    const absl::Status status = call();
    EXPECT_TRUE(status.ok()) << what << ": " << status;
    milliseconds.push_back(
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - before)
            .count());
  }
  std::ranges::sort(milliseconds);
  std::cout << what << ": p50 " << milliseconds[50] << " ms, p99 " << milliseconds[98] << " ms\n";
}

// What a server with ten thousand jobs asks, it finds by an index.
TEST_F(PostgresqlStoreTest, TenThousandJobsAreReadByIndexes) {
  constexpr int kJobs = 10'000;
  {
    const auto connection = Connect(address_);
    for (int first = 0; first < kJobs; first += 1'000) {
      std::vector<std::string> rows;
      std::vector<SqlValue> values;
      for (int i = first; i < first + 1'000; ++i) {
        v1::Job job = PendingJob(std::to_string(i));
        job.set_state(i < 20 ? v1::JOB_STATE_RUNNING
                             : (i < 500 ? v1::JOB_STATE_PENDING : v1::JOB_STATE_SUCCEEDED));
        job.mutable_train()->set_priority(i % 7);
        values.insert(values.end(), {job.name(), job.state(), job.train().priority(),
                                     SqlValue::Bytes(job.name()), SqlValue::Bytes(StoredJob(job))});
        const auto last = static_cast<int>(values.size());
        rows.push_back(absl::StrCat("($", last - 4, ",$", last - 3, ",$", last - 2, ",0,$",
                                    last - 1, ",'',$", last, ")"));
      }
      const auto added = connection->Run(
          absl::StrCat("INSERT INTO jobs (name, state, priority, create_time, request_id,"
                       " request_digest, job) VALUES ",
                       absl::StrJoin(rows, ",")),
          values);
      ASSERT_TRUE(added.ok()) << added.status();
    }
    for (int event = 1; event <= 3; ++event) {
      const auto added =
          connection->Run("INSERT INTO progress SELECT number, $1::int8, $2::bytea FROM jobs",
                          {event, SqlValue::Bytes(StoredProgress(Event(event)))});
      ASSERT_TRUE(added.ok()) << added.status();
    }
    // As autovacuum does by itself within a minute.
    for (const char* table : {"jobs", "progress"}) {
      ASSERT_TRUE(connection->RunScript(std::string("VACUUM ANALYZE ") + table).ok());
    }
  }
  const auto scans = [&] {
    const auto connection = Connect(address_);
    const auto rows = connection->Run(
        "SELECT sum(seq_scan)::int8 FROM pg_stat_user_tables"
        " WHERE schemaname = current_schema() AND relname IN ('jobs', 'progress')");
    EXPECT_TRUE(rows.ok()) << rows.status();
    return rows.ok() ? rows->Int(0, 0) : -1;
  };
  const int64_t before = scans();
  auto store = Open(address_);
  std::string token;
  std::vector<jobs::JobLease> leases;
  Time("list a page of 50", [&] {
    const auto page = store->List(50, token);
    if (page.ok()) token = page->next_page_token;
    return page.status();
  });
  Time("claim", [&] {
    const auto claimed = store->Claim([](v1::Job&) {});
    if (claimed.ok()) leases.push_back((*claimed)->lease);
    return claimed.status();
  });
  int turn = 0;
  Time("add an event", [&] { return store->AddProgress(leases[turn++], Event(4)); });
  turn = 0;
  Time("end a job", [&] { return store->Finish(leases[turn++], To(v1::JOB_STATE_SUCCEEDED)); });
  turn = 0;
  Time("set an alias", [&] { return store->SetAlias({"town", "serving"}, ++turn); });
  Time("get", [&] { return store->Get("jobs/" + std::to_string(++turn)).status(); });
  Time("find a request",
       [&] { return store->FindRequest("jobs/" + std::to_string(++turn)).status(); });
  Time("read events",
       [&] { return store->ListProgress("jobs/" + std::to_string(++turn), 1, 100).status(); });
  Time("count", [&] {
    return store->CountInState(turn++ % 2 == 0 ? v1::JOB_STATE_PENDING : v1::JOB_STATE_SUCCEEDED)
        .status();
  });
  Time("list pending",
       [&] { return store->ListInState(v1::JOB_STATE_PENDING, std::nullopt).status(); });
  EXPECT_TRUE(store->RequestCancel("jobs/5").ok());
  EXPECT_TRUE(store->Delete("jobs/9000").ok());
  EXPECT_TRUE(store->TakeAbandoned(To(v1::JOB_STATE_PENDING)).ok());
  // A session counts its scans when it ends, and gives the lock back then.
  store.reset();
  ASSERT_TRUE(LockStore(*Connect(address_), StoreUse::kAlone, std::chrono::seconds(10)).ok());
  EXPECT_EQ(scans(), before) << "a statement read a whole table";
}

// Each change, its connection lost as it is committed: before PostgreSQL has the commit, or after.
struct LostChange {
  const char* name;
  std::function<absl::Status(Store&, const jobs::JobLease& running)> change;
};

void PrintTo(const LostChange& change, std::ostream* out) { *out << change.name; }

class LostCommitTest : public PostgresqlStoreTest,
                       public testing::WithParamInterface<std::tuple<LostChange, bool>> {};

std::string Dump(PostgresqlConnection& connection) {
  std::string dump;
  for (const char* query :
       {"SELECT string_agg(name || state || fence || encode(job, 'hex'), E'\\n' ORDER BY number)"
        " FROM jobs",
        "SELECT string_agg(job_number || ' ' || sequence, E'\\n' ORDER BY 1) FROM progress",
        "SELECT string_agg(model || alias || version, E'\\n' ORDER BY 1) FROM aliases"}) {
    const auto rows = connection.Run(query);
    EXPECT_TRUE(rows.ok()) << rows.status();
    if (rows.ok()) dump += rows->Bytes(0, 0) + "\n--\n";
  }
  return dump;
}

TEST_P(LostCommitTest, ChangesNothingAndSucceedsWhenItIsRepeated) {
  const auto& [lost, reaches] = GetParam();
  LossyProxy proxy(cluster_->socket());
  const std::string through = absl::StrReplaceAll(
      address_, {{cluster_->socket().parent_path().string() + "&", proxy.folder().string() + "&"}});
  const auto store = Open(through);
  ASSERT_NE(store, nullptr);
  ASSERT_TRUE(store->Add(PendingJob("running"), "", "").ok());
  const auto claimed = store->Claim([](v1::Job&) {});
  ASSERT_TRUE(claimed.ok() && *claimed) << claimed.status();
  ASSERT_TRUE(store->Add(PendingJob("pending"), "request", "digest").ok());
  ASSERT_TRUE(store->SetAlias({"town", "serving"}, 1).ok());
  const auto watcher = Connect(address_);
  const std::string before = Dump(*watcher);

  proxy.LoseNextCommit(reaches);
  const absl::Status status = lost.change(*store, (*claimed)->lease);
  EXPECT_TRUE(errors::IsStoreAway(status)) << status;
  ASSERT_EQ(proxy.lost(), 1);
  if (reaches) {
    EXPECT_NE(Dump(*watcher), before) << "the commit did not reach PostgreSQL";
  }
  // A read brings the next connection, which takes the change back.
  EXPECT_TRUE(Eventually([&] { return store->Get("jobs/pending").status(); }).ok());
  EXPECT_EQ(Dump(*watcher), before);

  const absl::Status again = lost.change(*store, (*claimed)->lease);
  EXPECT_TRUE(again.ok()) << again;
  EXPECT_NE(Dump(*watcher), before);
}

INSTANTIATE_TEST_SUITE_P(
    All, LostCommitTest,
    testing::Combine(testing::Values(LostChange{"Add",
                                                [](Store& store, const jobs::JobLease&) {
                                                  return store.Add(PendingJob("new"), "another",
                                                                   "");
                                                }},
                                     LostChange{"Move",
                                                [](Store& store, const jobs::JobLease&) {
                                                  return store.Move(
                                                      v1::JOB_STATE_PENDING,
                                                      InState(PendingJob("pending"),
                                                              v1::JOB_STATE_CANCELLED));
                                                }},
                                     LostChange{"Claim",
                                                [](Store& store, const jobs::JobLease&) {
                                                  const auto claimed =
                                                      store.Claim([](v1::Job& job) {
                                                        job.mutable_attempts()->set_started(1);
                                                      });
                                                  EXPECT_TRUE(!claimed.ok() ||
                                                              claimed->has_value());
                                                  return claimed.status();
                                                }},
                                     LostChange{"Finish",
                                                [](Store& store, const jobs::JobLease& running) {
                                                  return store.Finish(running,
                                                                      To(v1::JOB_STATE_SUCCEEDED));
                                                }},
                                     LostChange{"RequestCancel",
                                                [](Store& store, const jobs::JobLease& running) {
                                                  return store.RequestCancel(running.job).status();
                                                }},
                                     LostChange{"AddProgress",
                                                [](Store& store, const jobs::JobLease& running) {
                                                  return store.AddProgress(running, Event(1));
                                                }},
                                     LostChange{"SetAlias",
                                                [](Store& store, const jobs::JobLease&) {
                                                  return store.SetAlias({"town", "serving"}, 2);
                                                }},
                                     LostChange{"NewAlias",
                                                [](Store& store, const jobs::JobLease&) {
                                                  return store.SetAlias({"town", "candidate"}, 2);
                                                }},
                                     LostChange{"DeleteAlias",
                                                [](Store& store, const jobs::JobLease&) {
                                                  return store.DeleteAlias({"town", "serving"});
                                                }}),
                     testing::Bool()),
    [](const auto& test) {
      return std::string(std::get<0>(test.param).name) +
             (std::get<1>(test.param) ? "AfterTheCommit" : "BeforeTheCommit");
    });

}  // namespace
}  // namespace maneuver::store::postgresql_store_test

namespace maneuver::store {

INSTANTIATE_TEST_SUITE_P(Postgresql, StoreTest,
                         testing::Values(&postgresql_store_test::NewPostgresqlStore));

}  // namespace maneuver::store
