#include "server/store/store_copy.h"

#include <gmock/gmock.h>
#include <google/protobuf/util/message_differencer.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "server/jobs/worker_capacity.h"
#include "server/store/open_store.h"
#include "server/store/sqlite_store.h"
#include "tests/postgresql/shared_cluster.h"
#include "tests/unit/server/store/store_suite.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::store::store_copy_test {
namespace {

namespace fs = std::filesystem;
using postgresql::NewStoreAddress;
using testing::HasSubstr;
using namespace std::string_literals;  // NOLINT(google-build-using-namespace)

class StoreCopyTest : public postgresql::WithStore {
 protected:
  void SetUp() override {
    WithStore::SetUp();
    if (IsSkipped() || HasFatalFailure()) return;
    Fill();
  }

  // Jobs in every state that a killed server leaves, with events and request ids; a gap.
  void Fill() {
    auto store = OpenStore(data_dir(), "");
    ASSERT_TRUE(store.ok()) << store.status();
    for (const char* id : {"a", "b", "c", "d", "last"}) {
      ASSERT_TRUE((*store)->Add(PendingJob(id), std::string(id) + "\0'id"s, "digest").ok());
    }
    ASSERT_TRUE(
        (*store)
            ->Move(v1::JOB_STATE_PENDING, InState(PendingJob("last"), v1::JOB_STATE_CANCELLED))
            .ok());
    ASSERT_TRUE((*store)->Delete("jobs/last").ok());
    for (const v1::JobState end :
         {v1::JOB_STATE_SUCCEEDED, v1::JOB_STATE_FAILED, v1::JOB_STATE_RUNNING}) {
      const auto claimed = (*store)->Claim([](v1::Job&) {});
      ASSERT_TRUE(claimed.ok() && *claimed);
      for (int i = 1; i <= 3; ++i) {
        ASSERT_TRUE((*store)->AddProgress((*claimed)->lease, Event(i)).ok());
      }
      if (end != v1::JOB_STATE_RUNNING) {
        ASSERT_TRUE((*store)->Finish((*claimed)->lease, To(end)).ok());
      }
    }
    ASSERT_TRUE((*store)->SetAlias({"town", "serving"}, 3).ok());
    ASSERT_TRUE((*store)->SetAlias({"town", "candidate"}, 4).ok());
    before_ = Read(**store);
  }

  static std::vector<v1::Job> Read(Store& store) {
    const auto page = store.List(100, "");
    EXPECT_TRUE(page.ok()) << page.status();
    return page.ok() ? page->jobs : std::vector<v1::Job>();
  }

  fs::path data_dir() const { return folder_.path(); }

  const TemporaryFolder folder_;
  std::vector<v1::Job> before_;
};

TEST_F(StoreCopyTest, AServerOverTheCopyFindsEverythingAndGoesOn) {
  const auto copied = CopyStore(data_dir(), address_);
  ASSERT_TRUE(copied.ok()) << copied.status();
  EXPECT_EQ(copied->ToString(),
            "4 jobs (1 pending, 1 running, 1 succeeded, 1 failed), 9 events, 2 aliases");

  auto store = OpenStore(data_dir(), address_);
  ASSERT_TRUE(store.ok()) << store.status();
  const std::vector<v1::Job> after = Read(**store);
  ASSERT_EQ(after.size(), before_.size());
  for (size_t i = 0; i < after.size(); ++i) {
    EXPECT_TRUE(google::protobuf::util::MessageDifferencer::Equals(after[i], before_[i]))
        << after[i].DebugString();
  }
  EXPECT_EQ((*(*store)->FindRequest("b\0'id"s))->job.name(), "jobs/b");
  EXPECT_EQ((*store)->ListProgress("jobs/a", 1, 10)->size(), 2u);
  EXPECT_EQ(*(*store)->GetAlias({"town", "serving"}), 3);
  const auto abandoned = (*store)->TakeAbandoned(To(v1::JOB_STATE_PENDING));
  ASSERT_TRUE(abandoned.ok()) << abandoned.status();
  EXPECT_THAT(NamesOf(*abandoned), testing::ElementsAre("jobs/c"));
  // A new job comes after all others, also those that were deleted.
  ASSERT_TRUE((*store)->Add(PendingJob("new"), "", "").ok());
  EXPECT_EQ((*store)->List(1, "")->jobs.front().name(), "jobs/new");
  EXPECT_EQ((*store)->List(1, "")->next_page_token, "6");
}

TEST_F(StoreCopyTest, ACopiedJobWaitsForAServerThatCanRunIt) {
  {
    auto store = OpenStore(data_dir(), "");
    ASSERT_TRUE(store.ok()) << store.status();
    v1::Job job = PendingJob("on-gpu");
    job.mutable_train()->set_priority(9);
    job.mutable_train()->set_ranks(2);
    job.mutable_train()->mutable_settings()->set_device("cuda");
    job.mutable_memory()->set_total_bytes(1'000);
    ASSERT_TRUE((*store)->Add(job, "", "").ok());
  }
  ASSERT_TRUE(CopyStore(data_dir(), address_).ok());
  auto store = OpenStore(data_dir(), address_);
  ASSERT_TRUE(store.ok()) << store.status();
  const auto begin = [](v1::Job&) {};
  const auto other = (*store)->Claim(begin, jobs::WorkerCapacity{.devices = {"cpu"}});
  ASSERT_TRUE(other.ok() && *other) << other.status();
  EXPECT_EQ((*other)->job.name(), "jobs/d");
  for (const jobs::WorkerCapacity& small :
       {jobs::WorkerCapacity{.devices = {"cpu"}},
        jobs::WorkerCapacity{.devices = {"cuda"}, .ranks = 1},
        jobs::WorkerCapacity{.devices = {"cuda"}, .memory_bytes = 1'999}}) {
    const auto none = (*store)->Claim(begin, small);
    ASSERT_TRUE(none.ok()) << none.status();
    EXPECT_FALSE(none->has_value());
  }
  const auto claimed = (*store)->Claim(
      begin, jobs::WorkerCapacity{.devices = {"cuda"}, .ranks = 2, .memory_bytes = 2'000});
  ASSERT_TRUE(claimed.ok() && *claimed) << claimed.status();
  EXPECT_EQ((*claimed)->job.name(), "jobs/on-gpu");
}

TEST_F(StoreCopyTest, AFolderIsNeverServedByAStoreThatDoesNotKnowItsJobs) {
  // Its jobs are in the folder.
  const absl::Status not_copied = OpenStore(data_dir(), address_).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(not_copied)) << not_copied;
  EXPECT_THAT(std::string(not_copied.message()), HasSubstr("maneuverd store copy"));
  ASSERT_TRUE(CopyStore(data_dir(), address_).ok());
  // They are in PostgreSQL.
  const absl::Status embedded = OpenStore(data_dir(), "").status();
  EXPECT_TRUE(absl::IsFailedPrecondition(embedded)) << embedded;
  EXPECT_THAT(std::string(embedded.message()), HasSubstr("--store"));
  EXPECT_FALSE(fs::exists(data_dir() / kEmbeddedStore));
  // They are in another database.
  const auto other = NewStoreAddress(*cluster_);
  ASSERT_TRUE(other.ok()) << other.status();
  const absl::Status elsewhere = OpenStore(data_dir(), *other).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(elsewhere)) << elsewhere;
  EXPECT_THAT(std::string(elsewhere.message()), HasSubstr("belongs to the store"));
  EXPECT_TRUE(OpenStore(data_dir(), address_).ok());
}

TEST_F(StoreCopyTest, ADatabaseThatIsInUseIsNotCopiedOver) {
  {
    const TemporaryFolder other;
    auto store = OpenStore(other.path(), address_);
    ASSERT_TRUE(store.ok()) << store.status();
    ASSERT_TRUE((*store)->SetAlias({"village", "serving"}, 1).ok());
  }
  const absl::Status refused = CopyStore(data_dir(), address_).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(refused)) << refused;
  EXPECT_THAT(std::string(refused.message()), HasSubstr("0 jobs, 1 aliases and 0 datasets"));
  // The folder's own store is as it was.
  EXPECT_TRUE(OpenStore(data_dir(), "").ok());
}

TEST_F(StoreCopyTest, ADatabaseWithoutTablesIsRefusedAndNothingChanges) {
  const absl::Status refused = CopyStore(data_dir(), cluster_->NewSchema()).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(refused)) << refused;
  EXPECT_THAT(std::string(refused.message()), HasSubstr("maneuverd store migrate"));
  EXPECT_TRUE(OpenStore(data_dir(), "").ok());
}

TEST_F(StoreCopyTest, ACopyThatWasCutOffAfterItsCommitIsFinished) {
  ASSERT_TRUE(CopyStore(data_dir(), address_).ok());
  fs::rename(data_dir() / kCopiedStore, data_dir() / kEmbeddedStore);
  // Neither store may be used until then.
  EXPECT_FALSE(OpenStore(data_dir(), "").ok());
  EXPECT_FALSE(OpenStore(data_dir(), address_).ok());
  const auto again = CopyStore(data_dir(), address_);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_TRUE(OpenStore(data_dir(), address_).ok());
}

TEST_F(StoreCopyTest, ACopyThatFailsLeavesTheFolderAsItWas) {
  // The third job's row cannot be written.
  auto connection = PostgresqlConnection::Open(postgresql::AsTest(address_));
  ASSERT_TRUE(connection.ok()) << connection.status();
  ASSERT_TRUE((*connection)->RunScript("ALTER TABLE jobs ADD CHECK (name <> 'jobs/c')").ok());
  EXPECT_FALSE(CopyStore(data_dir(), address_).ok());
  EXPECT_EQ((*connection)->Run("SELECT count(*) FROM jobs")->Int(0, 0), 0);
  auto store = OpenStore(data_dir(), "");
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_EQ(Read(**store).size(), before_.size());
}

TEST_F(StoreCopyTest, ACheckFindsADamagedRow) {
  ASSERT_TRUE(CopyStore(data_dir(), address_).ok());
  auto connection = PostgresqlConnection::Open(postgresql::AsTest(address_));
  ASSERT_TRUE(connection.ok()) << connection.status();
  ASSERT_TRUE((*connection)
                  ->RunScript("UPDATE progress SET progress = set_byte(progress, 1, 255)"
                              " WHERE job_number = 1 AND sequence = 2")
                  .ok());
  auto store = OpenStore(data_dir(), address_);
  ASSERT_TRUE(store.ok()) << store.status();
  EXPECT_TRUE(absl::IsDataLoss(CheckStore(**store).status()));
}

}  // namespace
}  // namespace maneuver::store::store_copy_test
