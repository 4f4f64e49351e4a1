#include "server/store/sqlite_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/resource.h>

#include <csignal>
#include <fstream>
#include <memory>
#include <string>
#include <utility>

#include "server/errors/error_details.h"
#include "tests/unit/server/store/store_suite.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::store::sqlite_store_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class SqliteMaker final : public StoreMaker {
 public:
  explicit SqliteMaker(std::filesystem::path file) : file_(std::move(file)) {}
  absl::StatusOr<std::unique_ptr<Store>> Open() override {
    auto store = SqliteStore::Open(file_);
    if (!store.ok()) return store.status();
    return *std::move(store);
  }
  absl::Status Run(const std::string& statement) override {
    sqlite3* database = nullptr;
    const bool done =
        sqlite3_open(file_.c_str(), &database) == SQLITE_OK &&
        sqlite3_exec(database, statement.c_str(), nullptr, nullptr, nullptr) == SQLITE_OK;
    const std::string error = sqlite3_errmsg(database);
    sqlite3_close(database);
    return done ? absl::OkStatus() : absl::InternalError(error);
  }

 private:
  const std::filesystem::path file_;
};

absl::StatusOr<std::unique_ptr<StoreMaker>> NewSqliteStore(const std::filesystem::path& folder) {
  return std::make_unique<SqliteMaker>(folder / "maneuver.db");
}

class SqliteStoreTest : public testing::Test {
 protected:
  void SetUp() override { Reopen(); }

  // Closes and opens the file, as a restart does.
  void Reopen() {
    store_.reset();
    auto store = SqliteStore::Open(file_);
    ASSERT_TRUE(store.ok()) << store.status();
    store_ = *std::move(store);
  }

  // Changes the file while it is closed, and says how opening it then ends.
  absl::Status OpenAfter(const std::string& statement) {
    store_.reset();
    EXPECT_TRUE(SqliteMaker(file_).Run(statement).ok());
    return SqliteStore::Open(file_).status();
  }

  const TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_ / "maneuver.db";
  std::unique_ptr<SqliteStore> store_;
};

// One flipped bit makes a 1 a 0.
TEST_F(SqliteStoreTest, RefusesAFileWithAnEventThatNobodyWouldMiss) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
  const auto claimed = store_->Claim([](v1::Job&) {});
  ASSERT_TRUE(claimed.ok() && *claimed);
  ASSERT_TRUE(store_->AddProgress((*claimed)->lease, Event(1)).ok());
  const absl::Status first = OpenAfter("UPDATE progress SET sequence = 0");
  EXPECT_TRUE(absl::IsDataLoss(first)) << first;
  EXPECT_TRUE(OpenAfter("UPDATE progress SET sequence = 1").ok());
  const absl::Status strange = OpenAfter("UPDATE progress SET job_number = 0");
  EXPECT_TRUE(absl::IsDataLoss(strange)) << strange;
  EXPECT_THAT(std::string(strange.message()), HasSubstr("event 1 of job number 0"));
}

TEST_F(SqliteStoreTest, AFileOfTheFirstSchemaIsBroughtUpToThisOne) {
  store_.reset();
  std::filesystem::remove(file_);
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &database), SQLITE_OK);
  const char* old =
      "CREATE TABLE jobs (number INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL UNIQUE,"
      " state INTEGER NOT NULL, create_time INTEGER NOT NULL, request_id TEXT UNIQUE,"
      " request_digest TEXT NOT NULL, job BLOB NOT NULL);"
      "CREATE INDEX jobs_by_state ON jobs (state, number);"
      "CREATE TABLE progress (job_number INTEGER NOT NULL REFERENCES jobs (number) ON DELETE"
      " CASCADE, sequence INTEGER NOT NULL, progress BLOB NOT NULL,"
      " PRIMARY KEY (job_number, sequence)) WITHOUT ROWID;"
      "CREATE TABLE aliases (model TEXT NOT NULL, alias TEXT NOT NULL, version INTEGER NOT NULL,"
      " PRIMARY KEY (model, alias)) WITHOUT ROWID;"
      "INSERT INTO jobs (name, state, create_time, request_digest, job)"
      " VALUES ('jobs/old', 1, 0, '', x'0a086a6f62732f6f6c642001');"  // Job{name: "jobs/old" state: PENDING}
      "PRAGMA user_version = 1";
  ASSERT_EQ(sqlite3_exec(database, old, nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(database);
  Reopen();
  EXPECT_EQ(store_->Get("jobs/old")->name(), "jobs/old");
  v1::Job urgent = PendingJob("urgent");
  urgent.mutable_train()->set_priority(1);
  ASSERT_TRUE(store_->Add(urgent, "", "").ok());
  Reopen();
  EXPECT_THAT(NamesOf(*store_->ListInState(v1::JOB_STATE_PENDING, std::nullopt)),
              ElementsAre("jobs/urgent", "jobs/old"));
}

TEST_F(SqliteStoreTest, ItCanBeCopiedWhileItIsOpen) {
  sqlite3* reader = nullptr;
  ASSERT_EQ(sqlite3_open_v2(file_.c_str(), &reader, SQLITE_OPEN_READONLY, nullptr), SQLITE_OK);
  sqlite3* copy = nullptr;
  ASSERT_EQ(sqlite3_open(":memory:", &copy), SQLITE_OK);
  sqlite3_backup* backup = sqlite3_backup_init(copy, "main", reader, "main");
  ASSERT_NE(backup, nullptr);
  EXPECT_EQ(sqlite3_backup_step(backup, -1), SQLITE_DONE);
  EXPECT_EQ(sqlite3_backup_finish(backup), SQLITE_OK);
  sqlite3_close(copy);
  sqlite3_close(reader);
}

// No file may grow while it exists, and so SQLite's writes fail with an error of the disk.
class FilesCannotGrow {
 public:
  FilesCannotGrow() : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit none = {.rlim_cur = 0, .rlim_max = before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &none);
  }
  ~FilesCannotGrow() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }
  FilesCannotGrow(const FilesCannotGrow&) = delete;
  FilesCannotGrow& operator=(const FilesCannotGrow&) = delete;

 private:
  rlimit before_ = {};
  void (*const handler_)(int);
};

TEST_F(SqliteStoreTest, AnErrorOfTheDiskSaysThatItWillPass) {
  {
    const FilesCannotGrow disk;
    const absl::Status failed = store_->Add(PendingJob("a"), "", "");
    EXPECT_TRUE(absl::IsUnavailable(failed)) << failed;
    EXPECT_TRUE(errors::IsStoreAway(failed));
    EXPECT_TRUE(errors::RetryDelay(failed).has_value());
  }
  EXPECT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
}

TEST_F(SqliteStoreTest, AFileThatAnotherProcessWritesToSaysThatItWillPass) {
  sqlite3* writer = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &writer), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(writer, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr), SQLITE_OK);
  const absl::Status failed = store_->Add(PendingJob("a"), "", "");
  EXPECT_TRUE(errors::IsStoreAway(failed)) << failed;
  EXPECT_THAT(std::string(failed.message()), HasSubstr("another process uses it"));
  sqlite3_close(writer);
}

TEST_F(SqliteStoreTest, ANewerSchemaIsRefused) {
  store_.reset();
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &database), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(database, "PRAGMA user_version = 99", nullptr, nullptr, nullptr),
            SQLITE_OK);
  sqlite3_close(database);
  const auto store = SqliteStore::Open(file_);
  EXPECT_TRUE(absl::IsFailedPrecondition(store.status())) << store.status();
  EXPECT_THAT(std::string(store.status().message()), HasSubstr("99"));
}

TEST_F(SqliteStoreTest, RefusesAFileThatIsNotADatabase) {
  store_.reset();
  std::filesystem::remove(file_);
  std::ofstream(file_) << std::string(5000, 'x');
  EXPECT_TRUE(absl::IsDataLoss(SqliteStore::Open(file_).status()));
}

}  // namespace
}  // namespace maneuver::store::sqlite_store_test

namespace maneuver::store {

INSTANTIATE_TEST_SUITE_P(Sqlite, StoreTest, testing::Values(&sqlite_store_test::NewSqliteStore));

}  // namespace maneuver::store
