// Datasets of several servers over one ledger in PostgreSQL and one folder.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_replace.h"
#include "model/data/dataset_folder.h"
#include "model/data/dataset_store.h"
#include "model/files/durable_file.h"
#include "model/files/file_system_failure.h"
#include "server/errors/error_details.h"
#include "server/store/postgresql_store.h"
#include "server/store/store_check.h"
#include "tests/postgresql/lossy_proxy.h"
#include "tests/postgresql/shared_cluster.h"
#include "tests/unit/model/data/local_dataset.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::store::shared_datasets_test {
namespace {

namespace fs = std::filesystem;
using data::DatasetLedger;
using data::DatasetStore;
using data::LocalDataset;
using data::NamesOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// Does something at a moment of another ledger's calls.
class InterruptedLedger final : public DatasetLedger {
 public:
  explicit InterruptedLedger(DatasetLedger& ledger) : ledger_(ledger) {}

  int listings = 0;  // calls of ListIds
  std::function<void()> before_add = [] {};
  std::function<void()> after_move = [] {};  // of a folder, before the commit

  absl::StatusOr<std::vector<v1::Dataset>> List(const std::string& after, size_t limit) override {
    return ledger_.List(after, limit);
  }
  absl::StatusOr<std::vector<std::string>> ListIds() override {
    ++listings;
    return ledger_.ListIds();
  }
  absl::StatusOr<v1::Dataset> Get(const std::string& id) override { return ledger_.Get(id); }
  absl::StatusOr<int64_t> TotalBytes() override { return ledger_.TotalBytes(); }
  absl::Status Add(const v1::Dataset& manifest, int64_t bytes,
                   const std::function<absl::Status()>& publish) override {
    before_add();
    return ledger_.Add(manifest, bytes, [&] { return Moved(publish()); });
  }
  absl::Status Remove(const std::string& id, const std::function<absl::Status()>& remove) override {
    return ledger_.Remove(id, [&] { return Moved(remove()); });
  }

 private:
  absl::Status Moved(absl::Status status) const {
    after_move();
    return status;
  }

  DatasetLedger& ledger_;
};

absl::Status Upload(const DatasetStore& store, const std::string& id, const LocalDataset& local,
                    const std::string& caller = "") {
  auto upload = store.BeginUpload(id, local.manifest, caller);
  if (!upload.ok()) return upload.status();
  if (absl::Status status = (*upload)->Append(local.bytes); !status.ok()) return status;
  return (*upload)->Commit().status();
}

// Repeats a call that another server kept waiting, because the disk is slow.
absl::Status UploadAtLast(const DatasetStore& store, const std::string& id,
                          const LocalDataset& local, const std::string& caller) {
  absl::Status status = Upload(store, id, local, caller);
  for (int i = 0; i < 10 && errors::IsStoreAway(status); ++i) {
    status = Upload(store, id, local, caller);
  }
  return status;
}

class SharedDatasetsTest : public postgresql::WithStore {
 protected:
  void SetUp() override {
    WithStore::SetUp();
    if (IsSkipped() || HasFatalFailure()) return;
    local_ = std::make_unique<LocalDataset>(folder_ / "local", 3);
    store_a_ = Share(address_);
    store_b_ = Share(address_);
    a_ = Open(store_a_->Datasets());
    b_ = Open(store_b_->Datasets());
  }

  static std::unique_ptr<PostgresqlStore> Share(const std::string& address) {
    auto store = PostgresqlStore::Share(address);
    EXPECT_TRUE(store.ok()) << store.status();
    return store.ok() ? *std::move(store) : nullptr;
  }
  std::unique_ptr<DatasetStore> Open(DatasetLedger* ledger, int64_t quota_bytes = 0) const {
    auto datasets = DatasetStore::Open(
        datasets_, {.quota_bytes = quota_bytes, .folders = {folder_.path()}, .is_shared = true},
        ledger);
    EXPECT_TRUE(datasets.ok()) << datasets.status();
    return datasets.ok() ? *std::move(datasets) : nullptr;
  }
  std::vector<std::string> Listed(const DatasetStore& store) const {
    return NamesOf(store.List("", 100));
  }
  bool IsCommitted(const DatasetStore& store) const {
    const auto answer = store.QueryUpload("town", local_->manifest);
    EXPECT_TRUE(answer.ok()) << answer.status();
    return answer.ok() && answer->has_committed();
  }
  // Makes lossy_, whose connection can be lost.
  void OpenLossy() {
    proxy_ = std::make_unique<postgresql::LossyProxy>(cluster_->socket());
    through_ = Share(absl::StrReplaceAll(
        address_,
        {{cluster_->socket().parent_path().string() + "&", proxy_->folder().string() + "&"}}));
    ASSERT_NE(through_, nullptr);
    lossy_ = Open(through_->Datasets());
  }
  // Runs a server in a process of its own, which dies when it has moved a folder.
  void DieWithinACommit(const std::function<void(DatasetStore&)>& call) const {
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      const auto store = Share(address_);
      InterruptedLedger ledger(*store->Datasets());
      const auto datasets = Open(&ledger);
      ledger.after_move = [] { _exit(42); };
      call(*datasets);
      _exit(1);
    }
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFEXITED(status));
    ASSERT_EQ(WEXITSTATUS(status), 42) << "it did not get as far";
  }

  const TemporaryFolder folder_;
  const fs::path datasets_ = folder_ / "datasets";
  std::unique_ptr<LocalDataset> local_;
  std::unique_ptr<PostgresqlStore> store_a_;
  std::unique_ptr<PostgresqlStore> store_b_;
  std::unique_ptr<DatasetStore> a_;
  std::unique_ptr<DatasetStore> b_;
  std::unique_ptr<postgresql::LossyProxy> proxy_;
  std::unique_ptr<PostgresqlStore> through_;
  std::unique_ptr<DatasetStore> lossy_;
};

TEST_F(SharedDatasetsTest, AnUploadThroughOneServerIsADatasetOfTheOther) {
  ASSERT_TRUE(Upload(*a_, "town", *local_).ok());
  EXPECT_THAT(Listed(*b_), ElementsAre("datasets/town"));
  EXPECT_EQ(b_->Get("town")->DebugString(), a_->Read("town")->DebugString());
  EXPECT_TRUE(absl::IsAlreadyExists(Upload(*b_, "town", *local_)));
  auto writer = b_->Create("outcomes", "of the server itself", 1'000);
  ASSERT_TRUE(writer.ok()) << writer.status();
  ASSERT_TRUE((*writer)->Add(data::SmallRecording("r")).ok());
  ASSERT_TRUE((*writer)->Commit().ok());
  EXPECT_EQ(a_->Get("outcomes")->recordings(), 1);
  const auto detached = b_->Detach("town");
  ASSERT_TRUE(detached.ok()) << detached.status();
  EXPECT_THAT(Listed(*a_), ElementsAre("datasets/outcomes"));
  EXPECT_TRUE(absl::IsNotFound(a_->Get("town").status()));
  EXPECT_TRUE(absl::IsNotFound(a_->Detach("town").status()));
  EXPECT_TRUE(Upload(*a_, "town", *local_).ok()) << "the name is free again";
}

TEST_F(SharedDatasetsTest, OfTwoUploadsThatCommitAtOnceOneIsTheDataset) {
  const LocalDataset other(folder_ / "other", 5);
  for (int round = 0; round < 5; ++round) {
    const std::string id = "town-" + std::to_string(round);
    absl::Status there;
    std::thread thread([&] { there = UploadAtLast(*b_, id, other, "b"); });
    const absl::Status here = UploadAtLast(*a_, id, *local_, "a");
    thread.join();
    ASSERT_NE(here.ok(), there.ok()) << here << " " << there;
    EXPECT_TRUE(absl::IsAlreadyExists(here.ok() ? there : here)) << here << " " << there;
    EXPECT_EQ(a_->Get(id)->recordings(), here.ok() ? 3 : 5);
    EXPECT_EQ(b_->Read(id)->recordings(), here.ok() ? 3 : 5);
    EXPECT_TRUE(data::VerifyDatasetFolder(a_->FolderOf(id)).ok());
  }
}

TEST_F(SharedDatasetsTest, ListsAndGetsDatasetsWhileTheFolderIsAway) {
  ASSERT_TRUE(Upload(*a_, "town", *local_).ok());
  fs::rename(datasets_, folder_ / "away");
  EXPECT_THAT(Listed(*b_), ElementsAre("datasets/town"));
  EXPECT_TRUE(b_->Get("town").ok());
  const absl::Status unread = b_->GetScenario("town", "r0").status();
  EXPECT_TRUE(absl::IsDataLoss(unread)) << unread;
  EXPECT_THAT(std::string(unread.message()), HasSubstr("the folder of datasets/town is gone"));
  EXPECT_TRUE(files::IsFileSystemFailure(b_->Detach("town").status()));
  fs::rename(folder_ / "away", datasets_);
  EXPECT_THAT(Listed(*b_), ElementsAre("datasets/town")) << "it was not taken for deleted";
  EXPECT_TRUE(b_->GetScenario("town", "r0").ok());
}

TEST_F(SharedDatasetsTest, ReadsRecordingsWhileTheDatabaseIsAway) {
  ASSERT_TRUE(Upload(*a_, "town", *local_).ok());
  OpenLossy();
  proxy_.reset();
  const DatasetStore& cut = *lossy_;
  EXPECT_TRUE(errors::IsStoreAway(cut.List("", 10).status()));
  EXPECT_TRUE(errors::IsStoreAway(cut.Get("town").status()));
  EXPECT_TRUE(errors::IsStoreAway(cut.CheckExists("town")));
  EXPECT_TRUE(errors::IsStoreAway(Upload(cut, "village", *local_)));
  EXPECT_TRUE(errors::IsStoreAway(cut.QueryUpload("town", local_->manifest).status()));
  EXPECT_TRUE(errors::IsStoreAway(cut.Register("village", folder_ / "local").status()));
  EXPECT_TRUE(errors::IsStoreAway(lossy_->Detach("town").status()));
  // What a job needs.
  EXPECT_TRUE(cut.Read("town").ok());
  EXPECT_TRUE(cut.GetScenario("town", "r0").ok());
}

TEST_F(SharedDatasetsTest, AdoptsFoldersThatNoLedgerKnows) {
  // Of the time when there was one server, or of the release before.
  const auto before = Open(nullptr);
  ASSERT_TRUE(Upload(*before, "town", *local_).ok());
  ASSERT_TRUE(before->Register("in-place", folder_ / "local").ok());
  ASSERT_TRUE(Upload(*before, "damaged", *local_).ok());
  fs::resize_file(datasets_ / "damaged" / data::kManifestFile, 10);
  fs::create_directories(datasets_ / "no dataset" / "of a name");
  EXPECT_THAT(Listed(*a_), IsEmpty());
  // Each server that starts, and that sweeps, and that is asked.
  const auto started = Open(store_a_->Datasets());
  EXPECT_THAT(Listed(*b_), ElementsAre("datasets/in-place", "datasets/town"));
  EXPECT_EQ(*store_b_->Datasets()->TotalBytes(), static_cast<int64_t>(local_->bytes.size()));
  ASSERT_TRUE(Upload(*before, "village", *local_).ok());
  ASSERT_TRUE(a_->AdoptFolders().ok());
  ASSERT_TRUE(Upload(*before, "wood", *local_).ok());
  EXPECT_TRUE(b_->Get("wood").ok());
  EXPECT_THAT(Listed(*b_), ElementsAre("datasets/in-place", "datasets/town", "datasets/village",
                                       "datasets/wood"));
  // A damaged one is on no list, but can be deleted.
  EXPECT_TRUE(absl::IsDataLoss(b_->Get("damaged").status()));
  EXPECT_TRUE(b_->Detach("damaged").ok());
  EXPECT_TRUE(absl::IsNotFound(b_->Get("damaged").status()));
}

TEST_F(SharedDatasetsTest, LooksForNewFoldersOnlyWhenTheFolderHasChanged) {
  InterruptedLedger ledger(*store_b_->Datasets());
  const auto b = Open(&ledger);
  ASSERT_TRUE(Upload(*Open(nullptr), "town", *local_).ok());
  ASSERT_TRUE(b->AdoptNewFolders().ok());
  EXPECT_THAT(Listed(*a_), ElementsAre("datasets/town"));
  const int listings = ledger.listings;
  ASSERT_TRUE(b->AdoptNewFolders().ok());
  EXPECT_EQ(ledger.listings, listings);
  // The clock of a file system may stand still for some milliseconds.
  fs::last_write_time(datasets_, fs::last_write_time(datasets_) + std::chrono::seconds(1));
  ASSERT_TRUE(b->AdoptNewFolders().ok());
  EXPECT_EQ(ledger.listings, listings + 1);
}

TEST_F(SharedDatasetsTest, AdoptsNoFolderThatIsDeletedOrReplacedMeanwhile) {
  const auto before = Open(nullptr);
  ASSERT_TRUE(Upload(*before, "town", *local_).ok());
  InterruptedLedger ledger(*store_b_->Datasets());
  fs::rename(datasets_ / "town", folder_ / "later");
  const auto b = Open(&ledger);
  fs::rename(folder_ / "later", datasets_ / "town");
  ledger.before_add = [&] { EXPECT_TRUE(a_->Detach("town").ok()); };
  EXPECT_TRUE(absl::IsNotFound(b->Get("town").status()));
  EXPECT_THAT(Listed(*b), IsEmpty());

  ASSERT_TRUE(Upload(*before, "town", *local_).ok());
  ledger.before_add = [&] {
    EXPECT_TRUE(before->Detach("town").ok());
    EXPECT_TRUE(Upload(*before, "town", LocalDataset(folder_ / "other", 5)).ok());
  };
  EXPECT_TRUE(absl::IsNotFound(b->Get("town").status()));
  EXPECT_EQ(a_->Get("town")->recordings(), 5);
}

TEST_F(SharedDatasetsTest, ADatasetWhoseServerDiedBeforeItWasListedIsAdoptedWhole) {
  DieWithinACommit([&](DatasetStore& dying) { (void)Upload(dying, "town", *local_); });
  ASSERT_TRUE(fs::exists(a_->FolderOf("town")));
  EXPECT_THAT(Listed(*a_), IsEmpty());
  EXPECT_TRUE(IsCommitted(*b_))
      << "a client that repeats the upload must learn that the dataset exists";
  EXPECT_THAT(Listed(*a_), ElementsAre("datasets/town"));
  EXPECT_TRUE(data::VerifyDatasetFolder(a_->FolderOf("town")).ok());
}

TEST_F(SharedDatasetsTest, ADeletionWhoseServerDiedIsRepeated) {
  ASSERT_TRUE(Upload(*a_, "town", *local_).ok());
  DieWithinACommit([](DatasetStore& dying) { (void)dying.Detach("town"); });
  EXPECT_THAT(Listed(*b_), ElementsAre("datasets/town"));
  EXPECT_TRUE(absl::IsDataLoss(b_->CheckExists("town")));
  EXPECT_TRUE(absl::IsAlreadyExists(Upload(*b_, "town", *local_)));
  EXPECT_TRUE(b_->AdoptFolders().ok());
  const auto detached = b_->Detach("town");
  ASSERT_TRUE(detached.ok()) << detached.status();
  EXPECT_THAT(Listed(*a_), IsEmpty());
  EXPECT_TRUE(Upload(*a_, "town", *local_).ok());
}

TEST_F(SharedDatasetsTest, TheQuotaCountsTheDatasetsOfAllServers) {
  const auto quota = static_cast<int64_t>(local_->bytes.size() * 3 / 2);
  const auto here = Open(store_a_->Datasets(), quota);
  const auto there = Open(store_b_->Datasets(), quota);
  ASSERT_TRUE(here->Register("in-place", folder_ / "local").ok());
  ASSERT_TRUE(Upload(*here, "town", *local_).ok()) << "shards in place do not count";
  EXPECT_TRUE(absl::IsFailedPrecondition(Upload(*there, "village", *local_)));
  ASSERT_TRUE(here->Detach("town").ok());
  EXPECT_TRUE(Upload(*there, "village", *local_).ok());
}

TEST_F(SharedDatasetsTest, ADamagedManifestIsListedByItsNameAndFoundByACheck) {
  ASSERT_TRUE(Upload(*a_, "town", *local_).ok());
  const auto sound = CheckStore(*store_a_);
  ASSERT_TRUE(sound.ok()) << sound.status();
  EXPECT_EQ(sound->ToString(), "0 jobs, 0 events, 0 aliases, 1 dataset");
  const auto connection = PostgresqlConnection::Open(postgresql::AsTest(address_));
  ASSERT_TRUE(connection.ok()) << connection.status();
  ASSERT_TRUE(
      (*connection)->RunScript("UPDATE datasets SET manifest = set_byte(manifest, 9, 1)").ok());
  EXPECT_TRUE(absl::IsDataLoss(CheckStore(*store_a_).status()));
  EXPECT_TRUE(absl::IsDataLoss(b_->Get("town").status()));
  EXPECT_THAT(Listed(*b_), ElementsAre("datasets/town"));
  EXPECT_EQ(b_->List("", 1)->front().shards_size(), 0);
  EXPECT_TRUE(b_->Detach("town").ok());
  EXPECT_THAT(Listed(*b_), IsEmpty());
}

class LostDatasetCommitTest : public SharedDatasetsTest, public testing::WithParamInterface<bool> {
 protected:
  void SetUp() override {
    SharedDatasetsTest::SetUp();
    if (IsSkipped() || cluster_ == nullptr) return;
    OpenLossy();
  }
};

TEST_P(LostDatasetCommitTest, AnUploadIsThereWhenItIsRepeated) {
  proxy_->LoseNextCommit(GetParam());
  const absl::Status lost = Upload(*lossy_, "town", *local_);
  EXPECT_TRUE(errors::IsStoreAway(lost)) << lost;
  ASSERT_EQ(proxy_->lost(), 1);
  EXPECT_TRUE(IsCommitted(*b_));
  EXPECT_THAT(Listed(*b_), ElementsAre("datasets/town"));
  EXPECT_TRUE(data::VerifyDatasetFolder(b_->FolderOf("town")).ok());
}

TEST_P(LostDatasetCommitTest, ADeletionIsCompletedWhenItIsRepeated) {
  ASSERT_TRUE(Upload(*a_, "town", *local_).ok());
  proxy_->LoseNextCommit(GetParam());
  const absl::Status lost = lossy_->Detach("town").status();
  EXPECT_TRUE(errors::IsStoreAway(lost)) << lost;
  const absl::Status again = b_->Detach("town").status();
  EXPECT_TRUE(GetParam() ? absl::IsNotFound(again) : again.ok()) << again;
  EXPECT_THAT(Listed(*b_), IsEmpty());
  EXPECT_TRUE(absl::IsNotFound(b_->CheckExists("town")));
}

INSTANTIATE_TEST_SUITE_P(All, LostDatasetCommitTest, testing::Bool(), [](const auto& test) {
  return std::string(test.param ? "AfterTheCommit" : "BeforeTheCommit");
});

}  // namespace
}  // namespace maneuver::store::shared_datasets_test
