#include "server/store/store_repair.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "server/store/open_store.h"
#include "server/store/sqlite_store.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::store::store_repair_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const security::ModelAliasName kServing = {"town", "serving"};

v1::Job PendingJob(const std::string& id) {
  v1::Job job;
  job.set_name("jobs/" + id);
  job.set_state(v1::JOB_STATE_PENDING);
  job.mutable_train()->set_model("models/town");
  return job;
}

class StoreRepairTest : public testing::Test {
 protected:
  // A store with two jobs and an alias, and its back-up.
  void SetUp() override {
    fs::create_directories(data_dir_ / "models" / "town" / "1");
    fs::create_directories(data_dir_ / "models" / "town" / "2");
    fs::create_directories(backup_);
    const auto store = Open();
    ASSERT_TRUE(store->Add(PendingJob("old"), "request-old", "digest-old").ok());
    ASSERT_TRUE(store->Add(PendingJob("other"), "", "").ok());
    ASSERT_TRUE(store->SetAlias(kServing, 1).ok());
  }

  void BackUp() const {
    fs::copy_file(file_, backup_ / "maneuver.db");
    std::ofstream(backup_ / "SHA256SUMS")
        << absl::StrCat(*files::Sha256OfFile(file_), "  ./maneuver.db\n");
  }

  // Adds a job and moves the alias.
  void ChangeSinceThen() const {
    const auto store = Open();
    ASSERT_TRUE(store->Add(PendingJob("new"), "request-new", "digest-new").ok());
    ASSERT_TRUE(store->SetAlias(kServing, 2).ok());
  }

  std::unique_ptr<SqliteStore> Open() const {
    auto store = SqliteStore::Open(file_);
    EXPECT_TRUE(store.ok()) << store.status();
    return store.ok() ? *std::move(store) : nullptr;
  }

  void Execute(const char* sql) const {
    sqlite3* database = nullptr;
    ASSERT_EQ(sqlite3_open(file_.c_str(), &database), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(database, sql, nullptr, nullptr, nullptr), SQLITE_OK) << sql;
    sqlite3_close(database);
  }

  // Overwrites the page on which a table begins.
  void DestroyTable(const std::string& table) const {
    sqlite3* database = nullptr;
    ASSERT_EQ(sqlite3_open(file_.c_str(), &database), SQLITE_OK);
    sqlite3_stmt* select = nullptr;
    const std::string sql =
        "SELECT rootpage, (SELECT page_size FROM pragma_page_size) FROM sqlite_master "
        "WHERE name = '" +
        table + "'";
    ASSERT_EQ(sqlite3_prepare_v2(database, sql.c_str(), -1, &select, nullptr), SQLITE_OK);
    ASSERT_EQ(sqlite3_step(select), SQLITE_ROW);
    const auto page = sqlite3_column_int64(select, 0);
    const auto size = sqlite3_column_int64(select, 1);
    sqlite3_finalize(select);
    sqlite3_close(database);
    std::fstream file(file_, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp((page - 1) * size);
    file << std::string(static_cast<size_t>(size), 'x');
  }

  std::vector<std::string> Jobs() const {
    std::vector<std::string> names;
    const auto page = Open()->List(10, "");
    EXPECT_TRUE(page.ok()) << page.status();
    for (const v1::Job& job : page->jobs) names.push_back(job.name());
    return names;
  }

  const TemporaryFolder folder_;
  const fs::path data_dir_ = folder_ / "data";
  const fs::path backup_ = folder_ / "backup";
  const fs::path file_ = data_dir_ / kEmbeddedStore;
};

TEST_F(StoreRepairTest, LeavesASoundStoreAlone) {
  BackUp();
  ChangeSinceThen();
  const std::string before = *files::ReadFile(file_);
  const auto repair = RepairStore(data_dir_, backup_);
  ASSERT_TRUE(repair.ok()) << repair.status();
  EXPECT_THAT(repair->damage, IsEmpty());
  EXPECT_EQ(repair->contents.ToString(), "3 jobs (3 pending), 0 events, 1 alias");
  EXPECT_EQ(*files::ReadFile(file_), before);
  EXPECT_FALSE(fs::exists(data_dir_ / "maneuver.db.damaged"));
}

TEST_F(StoreRepairTest, KeepsWhatCanBeReadAndTakesTheRestFromTheBackUp) {
  BackUp();
  ChangeSinceThen();
  Execute("UPDATE jobs SET job = x'00' WHERE name = 'jobs/old'");
  const std::string damaged = *files::ReadFile(file_);
  const auto repair = RepairStore(data_dir_, backup_);
  ASSERT_TRUE(repair.ok()) << repair.status();
  EXPECT_THAT(repair->damage, HasSubstr("damaged"));
  EXPECT_EQ(repair->readable_jobs, 2);
  EXPECT_EQ(repair->readable_aliases, 1);
  EXPECT_THAT(Jobs(), ElementsAre("jobs/new", "jobs/other", "jobs/old"));
  const auto store = Open();
  EXPECT_EQ(*store->GetAlias(kServing), 2) << "the newer one";
  const auto request = store->FindRequest("request-new");
  ASSERT_TRUE(request.ok() && request->has_value());
  EXPECT_EQ((*request)->request_digest, "digest-new");
  EXPECT_EQ(*files::ReadFile(repair->damaged_file), damaged) << "kept as it was";
}

TEST_F(StoreRepairTest, TakesATableWhosePagesAreLostFromTheBackUp) {
  BackUp();
  ChangeSinceThen();
  DestroyTable("jobs");
  EXPECT_TRUE(absl::IsDataLoss(SqliteStore::Open(file_).status()));
  const auto repair = RepairStore(data_dir_, backup_);
  ASSERT_TRUE(repair.ok()) << repair.status();
  EXPECT_EQ(repair->readable_jobs, 0);
  EXPECT_THAT(Jobs(), ElementsAre("jobs/other", "jobs/old"));
  EXPECT_EQ(*Open()->GetAlias(kServing), 2) << "aliases could still be read";
}

TEST_F(StoreRepairTest, TakesEverythingFromTheBackUpIfTheFileIsNoDatabase) {
  BackUp();
  std::ofstream(file_) << std::string(5000, 'x');
  const auto repair = RepairStore(data_dir_, backup_);
  ASSERT_TRUE(repair.ok()) << repair.status();
  EXPECT_THAT(Jobs(), ElementsAre("jobs/other", "jobs/old"));
  EXPECT_EQ(*Open()->GetAlias(kServing), 1);
  // A second repair of a second damage keeps the first damaged file.
  std::ofstream(file_) << std::string(5000, 'y');
  const auto again = RepairStore(data_dir_, backup_);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_EQ(files::ReadFile(repair->damaged_file)->front(), 'x');
  EXPECT_EQ(files::ReadFile(again->damaged_file)->front(), 'y');
}

TEST_F(StoreRepairTest, KeepsOnlyWhatCanBeReadWithoutABackUp) {
  ChangeSinceThen();
  Execute("UPDATE jobs SET state = 4 WHERE name = 'jobs/other'");
  const auto repair = RepairStore(data_dir_, "");
  ASSERT_TRUE(repair.ok()) << repair.status();
  EXPECT_THAT(Jobs(), ElementsAre("jobs/new", "jobs/old"));
}

TEST_F(StoreRepairTest, DropsEventsThatCannotBe) {
  ChangeSinceThen();
  {
    const auto store = Open();
    const auto claimed = store->Claim([](v1::Job&) {});
    ASSERT_TRUE(claimed.ok() && *claimed);
    v1::JobProgress event;
    for (int i = 1; i <= 3; ++i) {
      event.set_sequence(i);
      ASSERT_TRUE(store->AddProgress((*claimed)->lease, event).ok());
    }
  }
  Execute("UPDATE progress SET sequence = 0 WHERE sequence = 1");
  Execute("UPDATE progress SET job_number = 0 WHERE sequence = 2");
  const auto repair = RepairStore(data_dir_, "");
  ASSERT_TRUE(repair.ok()) << repair.status();
  EXPECT_THAT(repair->damage, HasSubstr("event 2 of job number 0"));
  EXPECT_EQ(repair->contents.ToString(), "3 jobs (2 pending, 1 running), 1 event, 1 alias");
}

TEST_F(StoreRepairTest, DropsAliasesOfVersionsThatAreGone) {
  BackUp();
  fs::remove_all(data_dir_ / "models" / "town" / "1");
  std::ofstream(file_) << "damage";
  const auto repair = RepairStore(data_dir_, backup_);
  ASSERT_TRUE(repair.ok()) << repair.status();
  EXPECT_THAT(repair->dropped_aliases, ElementsAre("models/town/aliases/serving"));
  EXPECT_TRUE(Open()->ListAliases()->empty());
}

TEST_F(StoreRepairTest, RefusesADamagedBackUpAndChangesNothing) {
  BackUp();
  std::ofstream(backup_ / "maneuver.db", std::ios::app) << "x";
  std::ofstream(file_) << "damage";
  const auto repair = RepairStore(data_dir_, backup_);
  EXPECT_TRUE(absl::IsDataLoss(repair.status())) << repair.status();
  EXPECT_EQ(*files::ReadFile(file_), "damage");
  EXPECT_TRUE(absl::IsInvalidArgument(RepairStore(data_dir_, folder_.path()).status()));
  EXPECT_EQ(std::distance(fs::directory_iterator(data_dir_), {}), 2) << "models and the store";
}

}  // namespace
}  // namespace maneuver::store::store_repair_test
