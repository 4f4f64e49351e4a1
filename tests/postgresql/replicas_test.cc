// Servers that share a store, know of each other, and take the jobs that they can run.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "locks/mutex.h"
#include "server/jobs/replica_report.h"
#include "server/store/postgresql_store.h"
#include "tests/postgresql/shared_cluster.h"
#include "tests/unit/server/store/store_suite.h"

namespace maneuver::store::replicas_test {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

constexpr int64_t kGibibyte = int64_t{1} << 30;

class ReplicasTest : public postgresql::WithStore {
 protected:
  void SetUp() override {
    WithStore::SetUp();
    if (IsSkipped() || HasFatalFailure()) return;
    for (auto* store : {&a_, &b_}) {
      auto shared = PostgresqlStore::Share(address_);
      ASSERT_TRUE(shared.ok()) << shared.status();
      *store = *std::move(shared);
    }
  }

  static v1::Replica Called(const std::string& name) {
    v1::Replica replica;
    replica.set_name(name);
    replica.set_role(v1::REPLICA_ROLE_ALL);
    return replica;
  }
  static std::vector<std::string> Live(PostgresqlStore& store) {
    std::vector<std::string> names;
    const auto live = store.Replicas()->ListLive();
    EXPECT_TRUE(live.ok()) << live.status();
    if (live.ok()) {
      for (const v1::Replica& each : *live) names.push_back(each.name());
    }
    return names;
  }
  void Add(const std::string& id, const jobs::JobNeeds& needs, int priority = 0) {
    v1::Job job = PendingJob(id);
    job.mutable_train()->mutable_settings()->set_device(needs.device);
    job.mutable_train()->set_ranks(static_cast<int>(needs.ranks));
    job.mutable_train()->set_priority(priority);
    job.mutable_memory()->set_total_bytes(needs.memory_bytes / needs.ranks);
    ASSERT_TRUE(a_->Add(job, "", "").ok());
  }
  // The ids of all jobs that a server with this capacity takes, in order.
  static std::vector<std::string> ClaimAll(PostgresqlStore& store,
                                           const jobs::WorkerCapacity& worker) {
    std::vector<std::string> ids;
    for (;;) {
      const auto claimed = store.Claim([](v1::Job&) {}, worker);
      EXPECT_TRUE(claimed.ok()) << claimed.status();
      if (!claimed.ok() || !*claimed) return ids;
      ids.push_back((*claimed)->lease.job.substr(5));
    }
  }

  std::unique_ptr<PostgresqlStore> a_;
  std::unique_ptr<PostgresqlStore> b_;
};

TEST_F(ReplicasTest, AServerTakesTheJobsThatItCanRunByPriority) {
  Add("small", {"cpu", 1, 1 * kGibibyte});
  Add("graphics", {"cuda", 1, 1 * kGibibyte}, 9);
  Add("ranks", {"cpu", 4, 4 * kGibibyte}, 8);
  Add("large", {"cpu", 1, 30 * kGibibyte}, 7);
  Add("urgent", {"cpu", 1, 1 * kGibibyte}, 5);
  EXPECT_THAT(ClaimAll(*a_, {{"cpu"}, 2, 8 * kGibibyte}), ElementsAre("urgent", "small"));
  EXPECT_THAT(ClaimAll(*b_, {{"cpu", "cuda"}, 2, 8 * kGibibyte}), ElementsAre("graphics"));
  EXPECT_THAT(ClaimAll(*a_, {{"cpu"}, 4, 64 * kGibibyte}), ElementsAre("ranks", "large"));
}

TEST_F(ReplicasTest, CountsWhatPendingJobsNeed) {
  Add("a", {"cpu", 1, kGibibyte});
  Add("b", {"cpu", 4, 4 * kGibibyte});
  Add("c", {"cpu", 1, kGibibyte});
  Add("d", {"cuda", 1, kGibibyte});
  ClaimAll(*a_, {{"cuda"}, 1, kGibibyte});
  const auto needs = b_->Replicas()->CountPendingNeeds();
  ASSERT_TRUE(needs.ok()) << needs.status();
  std::map<int64_t, int64_t> jobs;  // by ranks
  for (const auto& [need, count] : *needs) {
    EXPECT_EQ(need.device, "cpu");
    EXPECT_EQ(need.memory_bytes, need.ranks * kGibibyte);
    jobs[need.ranks] = count;
  }
  EXPECT_THAT(jobs, ElementsAre(std::pair(1, 2), std::pair(4, 1)));
}

TEST_F(ReplicasTest, EveryServerSeesWhatTheOthersTell) {
  v1::Replica worker = Called("worker");
  worker.mutable_job_capacity()->set_ranks(8);
  v1::Replica server = Called("server");
  v1::ModelAlias& loaded = *server.add_loaded();
  loaded.set_name("models/town/aliases/serving");
  loaded.set_model_version("models/town/versions/3");
  ASSERT_TRUE(a_->Replicas()->Report(worker).ok());
  ASSERT_TRUE(b_->Replicas()->Report(Called("before")).ok());
  ASSERT_TRUE(b_->Replicas()->Report(server).ok());
  const auto live = a_->Replicas()->ListLive();
  ASSERT_TRUE(live.ok()) << live.status();
  ASSERT_EQ(live->size(), 2u);
  EXPECT_EQ((*live)[0].SerializeAsString(), server.SerializeAsString());
  EXPECT_EQ((*live)[1].SerializeAsString(), worker.SerializeAsString());
  ASSERT_TRUE(b_->Replicas()->Leave().ok());
  EXPECT_THAT(Live(*a_), ElementsAre("worker"));
}

TEST_F(ReplicasTest, AServerThatNoLongerReportsIsNotLive) {
  ASSERT_TRUE(a_->Replicas()->Report(Called("a")).ok());
  ASSERT_TRUE(b_->Replicas()->Report(Called("b")).ok());
  const auto connection = PostgresqlConnection::Open(address_);
  ASSERT_TRUE(connection.ok());
  const auto age = (*connection)
                       ->Run("UPDATE replicas SET seen = seen - $1::int8 * interval '1 s'",
                             {jobs::kReplicaLife.count()});
  ASSERT_TRUE(age.ok()) << age.status();
  ASSERT_TRUE(b_->Replicas()->Report(Called("b")).ok());
  EXPECT_THAT(Live(*a_), ElementsAre("b"));
}

TEST_F(ReplicasTest, AReportFollowsChangesAndTakesTheServerOffTheListAtTheEnd) {
  Mutex mutex;
  std::string name = "first";
  const auto wait_for = [this](const std::string& wanted) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    std::vector<std::string> live;
    while (live = Live(*b_), live != std::vector{wanted}) {
      if (std::chrono::steady_clock::now() > deadline) break;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    EXPECT_THAT(live, ElementsAre(wanted));
  };
  {
    const jobs::ReplicaReport report(*a_->Replicas(), [&] {
      const MutexLock lock(mutex);
      return Called(name);
    });
    wait_for("first");
    {
      const MutexLock lock(mutex);
      name = "second";
    }
    wait_for("second");
  }
  EXPECT_THAT(Live(*b_), IsEmpty());
}

TEST_F(ReplicasTest, AStoreOfOneServerListsNone) {
  a_.reset();
  b_.reset();
  const auto alone = PostgresqlStore::Open(address_);
  ASSERT_TRUE(alone.ok()) << alone.status();
  EXPECT_EQ((*alone)->Replicas(), nullptr);
}

}  // namespace
}  // namespace maneuver::store::replicas_test
