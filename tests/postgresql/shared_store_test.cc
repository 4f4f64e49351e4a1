// Several servers over one store in PostgreSQL.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_replace.h"
#include "locks/mutex.h"
#include "server/errors/error_details.h"
#include "server/serving/version_store.h"
#include "server/store/postgresql_schema.h"
#include "server/store/postgresql_store.h"
#include "tests/postgresql/lossy_proxy.h"
#include "tests/postgresql/shared_cluster.h"
#include "tests/unit/server/store/store_suite.h"

namespace maneuver::store::shared_store_test {
namespace {

namespace fs = std::filesystem;
using postgresql::LossyProxy;
using security::ModelVersionName;
using serving::Maker;
using testing::HasSubstr;

const security::ModelAliasName kServing{"town", "serving"};

class SharedStoreTest : public postgresql::WithStore {
 protected:
  void SetUp() override {
    WithStore::SetUp();
    if (IsSkipped() || HasFatalFailure()) return;
    a_ = Share(address_);
    b_ = Share(address_);
    ASSERT_TRUE(a_ != nullptr && b_ != nullptr);
  }

  static std::unique_ptr<PostgresqlStore> Share(const std::string& address) {
    auto store = PostgresqlStore::Share(address);
    EXPECT_TRUE(store.ok()) << store.status();
    return store.ok() ? *std::move(store) : nullptr;
  }
  void Execute(const std::string& script) {
    const auto connection = PostgresqlConnection::Open(postgresql::AsTest(address_));
    ASSERT_TRUE(connection.ok()) << connection.status();
    const absl::Status status = (*connection)->RunScript(script);
    ASSERT_TRUE(status.ok()) << status;
  }
  // As if all leases had lasted their time.
  void EndLeases() { Execute("UPDATE jobs SET lease_end = clock_timestamp()"); }

  // A connection that was cut may hold the job for a moment.
  static jobs::JobLease Claim(Store& store) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (std::chrono::steady_clock::now() < deadline) {
      const auto claimed = store.Claim([](v1::Job&) {});
      EXPECT_TRUE(claimed.ok()) << claimed.status();
      if (!claimed.ok()) return {};
      if (*claimed) return (*claimed)->lease;
    }
    ADD_FAILURE() << "no job is pending";
    return {};
  }
  static std::vector<std::string> Take(Store& store) {
    const auto taken = store.TakeAbandoned(To(v1::JOB_STATE_PENDING));
    EXPECT_TRUE(taken.ok()) << taken.status();
    return taken.ok() ? NamesOf(*taken) : std::vector<std::string>();
  }
  static Maker MakerOf(const jobs::JobLease& lease) { return {lease.job, lease.fence}; }

  // Makes a version that is there.
  void Announce(const ModelVersionName& name) { ASSERT_TRUE(a_->Ledger()->Adopt({name}).ok()); }

  std::unique_ptr<PostgresqlStore> a_;
  std::unique_ptr<PostgresqlStore> b_;
};

TEST_F(SharedStoreTest, NobodyOwnsAStoreThatOthersShare) {
  const auto connection = PostgresqlConnection::Open(address_);
  ASSERT_TRUE(connection.ok());
  const absl::Status refused = LockStore(**connection, StoreUse::kAlone, std::chrono::seconds(0));
  EXPECT_TRUE(errors::IsStoreAway(refused)) << refused;
  a_.reset();
  b_.reset();
  const auto owner = PostgresqlStore::Open(address_);
  ASSERT_TRUE(owner.ok()) << owner.status();
  const absl::Status shared = LockStore(**connection, StoreUse::kShared, std::chrono::seconds(0));
  EXPECT_TRUE(errors::IsStoreAway(shared)) << shared;
  EXPECT_THAT(std::string(shared.message()), HasSubstr("--shared"));
}

TEST_F(SharedStoreTest, AServerWhoseStoreAnotherOneOwnedMeanwhileStops) {
  Execute(
      "UPDATE store SET epoch = epoch + 1;"
      "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid()"
      " AND application_name = 'maneuverd'");
  const absl::Status refused = a_->SetAliasIf(kServing, 1, {}).status();
  EXPECT_TRUE(errors::IsStoreAway(refused)) << refused;
  EXPECT_THAT(std::string(refused.message()), HasSubstr("another maneuverd has used this store"));
}

// Counts how often a listener was told of a change.
class Told {
 public:
  void Tell() {
    {
      const MutexLock lock(mutex_);
      ++count_;
    }
    changed_.NotifyAll();
  }
  int count() {
    const MutexLock lock(mutex_);
    return count_;
  }
  // Returns whether the count comes to exceed `count`.
  bool Exceeds(int count) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    const MutexLock lock(mutex_);
    while (count_ <= count && changed_.WaitUntil(mutex_, deadline)) {
    }
    return count_ > count;
  }

 private:
  Mutex mutex_;
  CondVar changed_;
  int count_ ABSL_GUARDED_BY(mutex_) = 0;
};

TEST_F(SharedStoreTest, TheDatabaseTellsAnotherServerOfEachChangeOfModels) {
  serving::VersionLedger& ledger = *a_->Ledger();
  Told told;
  const auto listener = b_->ListenForModels([&] { told.Tell(); });
  ASSERT_TRUE(told.Exceeds(0));  // it has connected
  ASSERT_EQ(*ledger.Reserve("town", {}), 1);
  const ModelVersionName name{"town", 1};
  const std::vector<std::function<absl::Status()>> changes = {
      [&] { return ledger.Announce(name, {}); },
      [&] { return a_->SetAlias(kServing, 1); },
      [&] { return ledger.Change(name, {}, [] { return absl::OkStatus(); }); },
      [&] { return a_->DeleteAlias(kServing); },
      [&] { return ledger.Retract(name); },
  };
  for (size_t i = 0; i < changes.size(); ++i) {
    const int before = told.count();
    const absl::Status changed = changes[i]();
    ASSERT_TRUE(changed.ok()) << changed;
    ASSERT_TRUE(told.Exceeds(before)) << "change " << i;
  }
}

// Any role that may connect can do this.
TEST_F(SharedStoreTest, AFloodOfNotificationsIsToldOfTwentyTimesASecond) {
  Announce({"town", 1});
  Told told;
  const auto listener = b_->ListenForModels([&] { told.Tell(); });
  ASSERT_TRUE(told.Exceeds(0));
  const int before = told.count();
  const auto start = std::chrono::steady_clock::now();
  Execute(
      "DO $$ BEGIN FOR i IN 1..2000 LOOP PERFORM pg_notify('maneuver_models', ''); COMMIT;"
      " END LOOP; END $$");
  const std::chrono::milliseconds time =
      std::chrono::ceil<std::chrono::milliseconds>(std::chrono::steady_clock::now() - start);
  EXPECT_LE(told.count() - before, time.count() / 50 + 2);
  // The last one is not lost.
  ASSERT_TRUE(a_->SetAlias(kServing, 1).ok());
  EXPECT_TRUE(told.Exceeds(before));
}

TEST_F(SharedStoreTest, AListenerThatLosesItsConnectionListensAgain) {
  Announce({"town", 1});
  Told told;
  const auto listener = b_->ListenForModels([&] { told.Tell(); });
  ASSERT_TRUE(told.Exceeds(0));
  const int before = told.count();
  Execute(
      "SELECT pg_terminate_backend(pid) FROM pg_stat_activity"
      " WHERE query = 'LISTEN maneuver_models'");
  ASSERT_TRUE(told.Exceeds(before)) << "something may have changed meanwhile";
  const int connected = told.count();
  ASSERT_TRUE(a_->SetAlias(kServing, 1).ok());
  EXPECT_TRUE(told.Exceeds(connected));
}

TEST_F(SharedStoreTest, AnAdditionIsMadeWhileServersUseTheStoreAndTheyGoOn) {
  std::vector<SchemaStep> steps = StoreMigrations();
  steps.push_back({"ALTER TABLE jobs ADD COLUMN colour TEXT", /*is_addition=*/true});
  const auto connection = PostgresqlConnection::Open(address_);
  ASSERT_TRUE(connection.ok()) << connection.status();
  const auto before = ReadSchemaVersion(**connection);
  ASSERT_TRUE(before.ok()) << before.status();
  EXPECT_TRUE(IsAddition(*before, steps));
  const auto migrated = Migrate(**connection, steps);
  ASSERT_TRUE(migrated.ok()) << migrated.status();
  EXPECT_EQ(ReadSchemaVersion(**connection)->latest, before->latest + 1);
  EXPECT_EQ(ReadSchemaVersion(**connection)->needed, before->needed);
  ASSERT_TRUE(a_->Add(PendingJob("a"), "", "").ok());
  // Their next connection finds the tables good, too, and so does a server that starts.
  Execute(
      "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid()"
      " AND application_name = 'maneuverd'");
  EXPECT_TRUE(a_->Get("jobs/a").ok());
  EXPECT_TRUE(b_->Get("jobs/a").ok());
  EXPECT_NE(Share(address_), nullptr);
  // Their release has nothing to migrate.
  const auto again = PostgresqlConnection::Open(address_);
  ASSERT_TRUE(again.ok());
  EXPECT_TRUE(Migrate(**again, StoreMigrations()).ok());
  EXPECT_EQ(ReadSchemaVersion(**again)->latest, before->latest + 1);
}

TEST_F(SharedStoreTest, AStepThatIsNoAdditionNeedsTheStoreAlone) {
  std::vector<SchemaStep> steps = StoreMigrations();
  steps.push_back({"ALTER TABLE jobs DROP COLUMN create_time"});
  const auto connection = PostgresqlConnection::Open(address_);
  ASSERT_TRUE(connection.ok()) << connection.status();
  EXPECT_FALSE(IsAddition(*ReadSchemaVersion(**connection), steps));
  EXPECT_FALSE(IsAddition({}, steps));  // no tables
}

TEST_F(SharedStoreTest, EachJobIsClaimedByOneServer) {
  constexpr int kJobs = 40;
  for (int i = 0; i < kJobs; ++i) {
    ASSERT_TRUE(a_->Add(PendingJob(std::to_string(i)), "", "").ok());
  }
  std::vector<std::string> claimed[2];
  const auto claim_all = [&](Store& store, std::vector<std::string>& names) {
    for (;;) {
      const auto job = store.Claim([](v1::Job&) {});
      ASSERT_TRUE(job.ok()) << job.status();
      if (!*job) return;
      names.push_back((*job)->lease.job);
    }
  };
  std::thread other([&] { claim_all(*b_, claimed[1]); });
  claim_all(*a_, claimed[0]);
  other.join();
  std::vector<std::string> all = claimed[0];
  all.insert(all.end(), claimed[1].begin(), claimed[1].end());
  std::ranges::sort(all);
  EXPECT_EQ(all.size(), static_cast<size_t>(kJobs));
  EXPECT_EQ(std::ranges::unique(all).size(), 0u);
}

TEST_F(SharedStoreTest, AJobIsTakenOnceItsLeaseHasEndedAndNotBefore) {
  ASSERT_TRUE(a_->Add(PendingJob("a"), "", "").ok());
  const jobs::JobLease lease = Claim(*a_);
  EXPECT_TRUE(Take(*b_).empty());
  EndLeases();
  ASSERT_TRUE(a_->Renew(lease).ok());
  EXPECT_TRUE(Take(*b_).empty());
  // Its server is gone; that does not end the lease.
  a_.reset();
  EXPECT_TRUE(Take(*b_).empty());
  EndLeases();
  EXPECT_THAT(Take(*b_), testing::ElementsAre("jobs/a"));
  EXPECT_GT(Claim(*b_).fence, lease.fence);
}

TEST_F(SharedStoreTest, AJobThatAnOwnerLeftIsTaken) {
  a_.reset();
  b_.reset();
  {
    const auto owner = PostgresqlStore::Open(address_);
    ASSERT_TRUE(owner.ok()) << owner.status();
    ASSERT_TRUE((*owner)->Add(PendingJob("a"), "", "").ok());
    Claim(**owner);
  }
  a_ = Share(address_);
  EXPECT_THAT(Take(*a_), testing::ElementsAre("jobs/a"));
}

TEST_F(SharedStoreTest, NothingThatALateWorkerWritesCounts) {
  ASSERT_TRUE(a_->Add(PendingJob("a"), "", "").ok());
  Announce({"town", 1});
  const jobs::JobLease late = Claim(*a_);
  const auto number = a_->Ledger()->Reserve("town", MakerOf(late));
  ASSERT_TRUE(number.ok()) << number.status();
  EndLeases();
  ASSERT_EQ(Take(*b_).size(), 1u);
  Claim(*b_);

  EXPECT_TRUE(absl::IsAborted(a_->Renew(late).status()));
  EXPECT_TRUE(absl::IsAborted(a_->AddProgress(late, Event(1))));
  EXPECT_TRUE(absl::IsAborted(a_->Finish(late, To(v1::JOB_STATE_SUCCEEDED))));
  serving::VersionLedger& ledger = *a_->Ledger();
  EXPECT_TRUE(absl::IsAborted(ledger.Reserve("town", MakerOf(late)).status()));
  EXPECT_TRUE(absl::IsAborted(ledger.Announce({"town", *number}, MakerOf(late))));
  bool is_edited = false;
  EXPECT_TRUE(absl::IsAborted(ledger.Change({"town", 1}, MakerOf(late), [&] {
    is_edited = true;
    return absl::OkStatus();
  })));
  EXPECT_FALSE(is_edited);
  const auto moved = a_->SetAliasIf(kServing, 1, {.before = {}, .maker = MakerOf(late)});
  EXPECT_TRUE(absl::IsAborted(moved.status())) << moved.status();
  EXPECT_EQ(b_->Get("jobs/a")->state(), v1::JOB_STATE_RUNNING);
  EXPECT_FALSE(b_->Get("jobs/a")->has_progress());
  EXPECT_EQ(b_->Ledger()->ListVersions()->size(), 1u);
  EXPECT_TRUE(b_->ListAliases()->empty());
}

TEST_F(SharedStoreTest, TheWorkerOfAJobLearnsThatAnotherServerCancelledIt) {
  ASSERT_TRUE(a_->Add(PendingJob("a"), "", "").ok());
  const jobs::JobLease lease = Claim(*a_);
  EXPECT_FALSE(*a_->Renew(lease));
  ASSERT_TRUE(b_->RequestCancel("jobs/a").ok());
  EXPECT_TRUE(*a_->Renew(lease));
}

TEST_F(SharedStoreTest, NumbersOfVersionsAreGivenOnce) {
  constexpr int kNumbers = 20;
  Announce({"town", 3});
  ASSERT_TRUE(a_->Ledger()->AdoptDeleted({{"town", 7}}).ok());
  std::vector<int> numbers[2];
  const auto reserve = [&](Store& store, std::vector<int>& reserved) {
    for (int i = 0; i < kNumbers; ++i) {
      const auto number = store.Ledger()->Reserve("town", {});
      ASSERT_TRUE(number.ok()) << number.status();
      reserved.push_back(*number);
    }
  };
  std::thread other([&] { reserve(*b_, numbers[1]); });
  reserve(*a_, numbers[0]);
  other.join();
  std::vector<int> all = numbers[0];
  all.insert(all.end(), numbers[1].begin(), numbers[1].end());
  std::ranges::sort(all);
  for (int i = 0; i < 2 * kNumbers; ++i) EXPECT_EQ(all[static_cast<size_t>(i)], 8 + i);
  EXPECT_EQ(a_->Ledger()->ListVersions()->size(), 1u);  // a number makes no version
}

TEST_F(SharedStoreTest, AVersionWithAnAliasStaysAndADeletedOneGetsNone) {
  Announce({"town", 1});
  Announce({"town", 2});
  ASSERT_TRUE(a_->SetAlias(kServing, 1).ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(b_->Ledger()->Retract({"town", 1})));
  ASSERT_TRUE(b_->Ledger()->Retract({"town", 2}).ok());
  EXPECT_TRUE(absl::IsNotFound(a_->SetAlias(kServing, 2)));
  EXPECT_TRUE(absl::IsNotFound(a_->Ledger()->Retract({"town", 2})));
  // A folder that is still there does not bring it back.
  ASSERT_TRUE(a_->Ledger()->Adopt({{"town", 2}}).ok());
  EXPECT_EQ(a_->Ledger()->ListVersions()->size(), 1u);
}

// A connection that is lost as it commits, before PostgreSQL has the commit or after; then another
// server goes on before the first one is back.
class SharedLostCommitTest : public SharedStoreTest, public testing::WithParamInterface<bool> {
 protected:
  void SetUp() override {
    SharedStoreTest::SetUp();
    if (IsSkipped() || cluster_ == nullptr) return;
    proxy_ = std::make_unique<LossyProxy>(cluster_->socket());
    through_ = Share(absl::StrReplaceAll(
        address_,
        {{cluster_->socket().parent_path().string() + "&", proxy_->folder().string() + "&"}}));
    ASSERT_NE(through_, nullptr);
    Announce({"town", 1});
    Announce({"town", 2});
    Announce({"town", 3});
  }
  // Calls until the store is back: it tries to connect once a second.
  void Reconnect() {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (errors::IsStoreAway(through_->ListAliases().status()) &&
           std::chrono::steady_clock::now() < deadline) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }

  std::unique_ptr<LossyProxy> proxy_;
  std::unique_ptr<PostgresqlStore> through_;
};

TEST_P(SharedLostCommitTest, TakesBackNothingThatAnotherServerHasBuiltOn) {
  ASSERT_TRUE(a_->SetAlias(kServing, 1).ok());
  proxy_->LoseNextCommit(GetParam());
  EXPECT_TRUE(errors::IsStoreAway(through_->SetAlias(kServing, 2)));
  ASSERT_TRUE(a_->SetAlias(kServing, 3).ok());
  ASSERT_TRUE(a_->SetAlias(kServing, 2).ok());
  Reconnect();
  EXPECT_EQ(*through_->GetAlias(kServing), 2);
}

TEST_P(SharedLostCommitTest, KeepsAJobThatAnotherServerRunsMeanwhile) {
  proxy_->LoseNextCommit(GetParam());
  EXPECT_TRUE(errors::IsStoreAway(through_->Add(PendingJob("a"), "", "")));
  if (!GetParam()) {
    ASSERT_TRUE(a_->Add(PendingJob("a"), "", "").ok());
  }
  Claim(*a_);
  Reconnect();
  EXPECT_EQ(through_->Get("jobs/a")->state(), v1::JOB_STATE_RUNNING);
}

TEST_P(SharedLostCommitTest, ATakenLeaseIsNotGivenBackByItsFormerHolder) {
  ASSERT_TRUE(a_->Add(PendingJob("a"), "", "").ok());
  proxy_->LoseNextCommit(GetParam());
  EXPECT_TRUE(errors::IsStoreAway(through_->Claim([](v1::Job&) {}).status()));
  EndLeases();
  Take(*a_);
  const jobs::JobLease lease = Claim(*a_);
  Reconnect();
  EXPECT_TRUE(a_->AddProgress(lease, Event(1)).ok());
}

INSTANTIATE_TEST_SUITE_P(All, SharedLostCommitTest, testing::Bool(), [](const auto& test) {
  return std::string(test.param ? "AfterTheCommit" : "BeforeTheCommit");
});

// Two servers over one folder of models.
class SharedVersionsTest : public SharedStoreTest {
 protected:
  std::unique_ptr<serving::VersionStore> Open(Store& store) {
    auto versions = serving::VersionStore::Open(folder_ / "models", store.Ledger());
    EXPECT_TRUE(versions.ok()) << versions.status();
    return versions.ok() ? *std::move(versions) : nullptr;
  }
  fs::path FinishedModel() {
    fs::path finished = folder_ / ("finished-" + std::to_string(++finished_));
    MakeModel(finished);
    return finished;
  }
  static void MakeModel(const fs::path& model) {
    fs::create_directories(model);
    std::ofstream(model / "weights.safetensors") << "good";
    std::ofstream(model / "model.json") << "{}";
  }
  static absl::StatusOr<ModelVersionName> Publish(serving::VersionStore& versions,
                                                  const fs::path& finished, const Maker& maker) {
    return versions.Publish("town", finished, maker, [](const auto&) { return absl::OkStatus(); });
  }

  const TemporaryFolder folder_;
  int finished_ = 0;
};

TEST_F(SharedVersionsTest, AVersionThatOneServerPublishesIsKnownToTheOther) {
  MakeModel(folder_ / "models/town/4");  // of the time when there was one server
  std::ofstream(folder_ / "models/town/.last_version") << "6";
  const auto here = Open(*a_);
  const auto there = Open(*b_);
  EXPECT_TRUE(there->Contains({"town", 4}));
  const auto made = Publish(*here, FinishedModel(), {"uploads/a"});
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_EQ(made->version, 7);
  EXPECT_FALSE(there->Contains(*made));
  ASSERT_TRUE(there->Refresh().ok());
  EXPECT_TRUE(there->Contains(*made));
  EXPECT_EQ(there->FindMadeBy("town", "uploads/a"), *made);
  ASSERT_TRUE(there->Delete(*made).ok());
  ASSERT_TRUE(here->Refresh().ok());
  EXPECT_FALSE(here->Contains(*made));
  EXPECT_EQ(Publish(*here, FinishedModel(), {})->version, 8);
}

TEST_F(SharedVersionsTest, AWorkerWhoseLeaseEndedPublishesNothing) {
  const auto here = Open(*a_);
  const auto there = Open(*b_);
  ASSERT_TRUE(a_->Add(PendingJob("a"), "", "").ok());
  const jobs::JobLease late = Claim(*a_);
  // It ends while the version is checked, after its number was taken.
  const fs::path finished = FinishedModel();
  jobs::JobLease present;
  const auto refused = here->Publish("town", finished, MakerOf(late), [&](const auto&) {
    EndLeases();
    EXPECT_EQ(Take(*b_).size(), 1u);
    present = Claim(*b_);
    return absl::OkStatus();
  });
  EXPECT_TRUE(absl::IsAborted(refused.status())) << refused.status();
  EXPECT_TRUE(fs::exists(finished / "weights.safetensors"));
  EXPECT_FALSE(fs::exists(folder_ / "models/town/1"));
  const auto made = Publish(*there, FinishedModel(), MakerOf(present));
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_EQ(b_->Ledger()->ListVersions()->size(), 1u);
}

TEST_F(SharedVersionsTest, AFolderThatWasNeverAnnouncedIsNoVersion) {
  const auto here = Open(*a_);
  const auto number = a_->Ledger()->Reserve("town", {});
  ASSERT_TRUE(number.ok()) << number.status();
  MakeModel(here->FolderOf({"town", *number}));  // its server died here
  EXPECT_FALSE(Open(*b_)->Contains({"town", *number}));
}

TEST_F(SharedVersionsTest, AChangeOfLabelsHasARevisionOfItsOwn) {
  MakeModel(folder_ / "models/town/1");
  const auto here = Open(*a_);
  const auto there = Open(*b_);
  const int64_t before = there->Revision({"town", 1});
  ASSERT_TRUE(a_->Ledger()->Change({"town", 1}, {}, [] { return absl::OkStatus(); }).ok());
  ASSERT_TRUE(there->Refresh().ok());
  EXPECT_GT(there->Revision({"town", 1}), before);
}

}  // namespace
}  // namespace maneuver::store::shared_store_test
