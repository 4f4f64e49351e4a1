#include "server/jobs/sqlite_store.h"

#include <gmock/gmock.h>
#include <google/protobuf/util/message_differencer.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "tests/unit/temporary_folder.h"

namespace maneuver::jobs::sqlite_store_test {
namespace {

using google::protobuf::util::MessageDifferencer;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

v1::Job PendingJob(const std::string& id) {
  v1::Job job;
  job.set_name("jobs/" + id);
  job.set_state(v1::JOB_STATE_PENDING);
  job.mutable_train()->set_model("models/town");
  job.mutable_create_time()->set_seconds(1000);
  return job;
}

v1::Job InState(v1::Job job, v1::JobState state) {
  job.set_state(state);
  return job;
}

JobEdit To(v1::JobState state) {
  return [state](v1::Job& job) { job.set_state(state); };
}

v1::JobProgress Event(int64_t sequence) {
  v1::JobProgress progress;
  progress.set_sequence(sequence);
  progress.set_phase("joint");
  return progress;
}

std::vector<std::string> NamesOf(const std::vector<v1::Job>& jobs) {
  std::vector<std::string> names;
  for (const v1::Job& job : jobs) names.push_back(job.name());
  return names;
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

  ClaimedJob Claim() {
    const auto claimed = store_->Claim([](v1::Job&) {});
    EXPECT_TRUE(claimed.ok()) << claimed.status();
    if (!claimed.ok() || !*claimed) {
      ADD_FAILURE() << "no job is pending";
      return {};
    }
    return **claimed;
  }

  const TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_ / "maneuver.db";
  std::unique_ptr<SqliteStore> store_;
};

TEST_F(SqliteStoreTest, JobsProgressAndAliasesSurviveARestart) {
  const v1::Job job = PendingJob("a");
  ASSERT_TRUE(store_->Add(job, "request", "digest").ok());
  const ClaimedJob claimed = Claim();
  ASSERT_TRUE(store_->AddProgress(claimed.lease, Event(1)).ok());
  ASSERT_TRUE(store_->AddProgress(claimed.lease, Event(2)).ok());
  ASSERT_TRUE(store_->SetAlias({"town", "serving"}, 3).ok());

  Reopen();

  v1::Job expected = InState(job, v1::JOB_STATE_RUNNING);
  *expected.mutable_progress() = Event(2);
  const auto found = store_->Get("jobs/a");
  ASSERT_TRUE(found.ok()) << found.status();
  EXPECT_TRUE(MessageDifferencer::Equals(*found, expected)) << found->DebugString();
  const auto requested = store_->FindRequest("request");
  ASSERT_TRUE(requested.ok() && requested->has_value());
  EXPECT_EQ((*requested)->job.name(), "jobs/a");
  EXPECT_EQ((*requested)->request_digest, "digest");
  EXPECT_EQ(*store_->GetAlias({"town", "serving"}), 3);
}

TEST_F(SqliteStoreTest, ARequestIdBelongsToOneJobAndNoRequestIdToAny) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "request", "").ok());
  EXPECT_TRUE(absl::IsAlreadyExists(store_->Add(PendingJob("b"), "request", "")));
  EXPECT_TRUE(absl::IsNotFound(store_->Get("jobs/b").status()));
  ASSERT_TRUE(store_->Add(PendingJob("c"), "", "").ok());
  EXPECT_TRUE(store_->Add(PendingJob("d"), "", "").ok());
  EXPECT_FALSE(store_->FindRequest("")->has_value());
}

TEST_F(SqliteStoreTest, PagesAreNewestFirstWithoutGapsWhileJobsArrive) {
  for (const char* id : {"a", "b", "c", "d", "e"}) {
    ASSERT_TRUE(store_->Add(PendingJob(id), "", "").ok());
  }
  auto page = store_->List(2, "");
  ASSERT_TRUE(page.ok());
  EXPECT_THAT(NamesOf(page->jobs), ElementsAre("jobs/e", "jobs/d"));
  ASSERT_TRUE(store_->Add(PendingJob("f"), "", "").ok());
  page = store_->List(2, page->next_page_token);
  EXPECT_THAT(NamesOf(page->jobs), ElementsAre("jobs/c", "jobs/b"));
  page = store_->List(2, page->next_page_token);
  EXPECT_THAT(NamesOf(page->jobs), ElementsAre("jobs/a"));
  EXPECT_EQ(page->next_page_token, "");
  EXPECT_EQ(store_->List(6, "")->next_page_token, "");
}

TEST_F(SqliteStoreTest, AForeignPageTokenIsRefused) {
  for (const char* token : {"x", "-1", "0", "1 or 1"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(store_->List(2, token).status())) << token;
  }
}

TEST_F(SqliteStoreTest, OfTwoWhoMoveAJobOneWins) {
  const v1::Job job = PendingJob("a");
  ASSERT_TRUE(store_->Add(job, "", "").ok());
  EXPECT_TRUE(store_->Move(v1::JOB_STATE_PENDING, InState(job, v1::JOB_STATE_CANCELLED)).ok());
  const absl::Status late =
      store_->Move(v1::JOB_STATE_PENDING, InState(job, v1::JOB_STATE_CANCELLED));
  EXPECT_TRUE(absl::IsFailedPrecondition(late)) << late;
  EXPECT_THAT(std::string(late.message()), HasSubstr("cancelled"));
  EXPECT_EQ(store_->Get("jobs/a")->state(), v1::JOB_STATE_CANCELLED);
}

TEST_F(SqliteStoreTest, AForbiddenMoveChangesNothing) {
  const v1::Job job = PendingJob("a");
  ASSERT_TRUE(store_->Add(job, "", "").ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(
      store_->Move(v1::JOB_STATE_PENDING, InState(job, v1::JOB_STATE_SUCCEEDED))));
  // Only a worker with a lease has a running job.
  EXPECT_TRUE(absl::IsFailedPrecondition(
      store_->Move(v1::JOB_STATE_PENDING, InState(job, v1::JOB_STATE_RUNNING))));
  EXPECT_EQ(store_->Get("jobs/a")->state(), v1::JOB_STATE_PENDING);
  EXPECT_TRUE(absl::IsNotFound(
      store_->Move(v1::JOB_STATE_PENDING, InState(PendingJob("b"), v1::JOB_STATE_CANCELLED))));
}

TEST_F(SqliteStoreTest, JobsInAStateComeOldestFirst) {
  for (const char* id : {"a", "b", "c"}) ASSERT_TRUE(store_->Add(PendingJob(id), "", "").ok());
  ASSERT_TRUE(
      store_->Move(v1::JOB_STATE_PENDING, InState(PendingJob("b"), v1::JOB_STATE_CANCELLED)).ok());
  EXPECT_THAT(NamesOf(*store_->ListInState(v1::JOB_STATE_PENDING, std::nullopt)),
              ElementsAre("jobs/a", "jobs/c"));
  EXPECT_THAT(NamesOf(*store_->ListInState(v1::JOB_STATE_PENDING, 1)), ElementsAre("jobs/a"));
  EXPECT_EQ(*store_->CountInState(v1::JOB_STATE_PENDING), 2);
  EXPECT_EQ(*store_->CountInState(v1::JOB_STATE_FAILED), 0);
}

TEST_F(SqliteStoreTest, AHigherPriorityGoesBeforeAgeAndSurvivesARestart) {
  int priorities[] = {0, 5, -5, 5};
  for (int i = 0; i < 4; ++i) {
    v1::Job job = PendingJob(std::string(1, static_cast<char>('a' + i)));
    job.mutable_train()->set_priority(priorities[i]);
    ASSERT_TRUE(store_->Add(job, "", "").ok());
  }
  v1::Job evaluation = PendingJob("e");
  evaluation.mutable_evaluate()->set_priority(9);
  ASSERT_TRUE(store_->Add(evaluation, "", "").ok());
  Reopen();
  EXPECT_THAT(NamesOf(*store_->ListInState(v1::JOB_STATE_PENDING, std::nullopt)),
              ElementsAre("jobs/e", "jobs/b", "jobs/d", "jobs/a", "jobs/c"));
}

TEST_F(SqliteStoreTest, ClaimsTheMostUrgentJobAndThenTheOldest) {
  int priorities[] = {0, 5, 5};
  for (int i = 0; i < 3; ++i) {
    v1::Job job = PendingJob(std::string(1, static_cast<char>('a' + i)));
    job.mutable_train()->set_priority(priorities[i]);
    ASSERT_TRUE(store_->Add(job, "", "").ok());
  }
  for (const char* name : {"jobs/b", "jobs/c", "jobs/a"}) {
    const ClaimedJob claimed = Claim();
    EXPECT_EQ(claimed.job.name(), name);
    EXPECT_EQ(claimed.job.state(), v1::JOB_STATE_RUNNING);
    EXPECT_EQ(claimed.lease.job, name);
    EXPECT_EQ(store_->Get(name)->state(), v1::JOB_STATE_RUNNING);
  }
  const auto none = store_->Claim([](v1::Job&) { ADD_FAILURE() << "no job is left"; });
  ASSERT_TRUE(none.ok()) << none.status();
  EXPECT_FALSE(none->has_value());
}

TEST_F(SqliteStoreTest, StoresWhatChangesAsAJobBeginsAndEnds) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
  const auto begin = [](v1::Job& job) { job.mutable_attempts()->set_started(7); };
  const auto claimed = store_->Claim(begin);
  ASSERT_TRUE(claimed.ok() && *claimed) << claimed.status();
  EXPECT_EQ((*claimed)->job.attempts().started(), 7);
  EXPECT_EQ(store_->Get("jobs/a")->attempts().started(), 7);
  const auto end = [](v1::Job& job) {
    EXPECT_EQ(job.attempts().started(), 7);
    job.set_state(v1::JOB_STATE_SUCCEEDED);
    job.set_model_version("models/town/versions/3");
  };
  ASSERT_TRUE(store_->Finish((*claimed)->lease, end).ok());
  EXPECT_EQ(store_->Get("jobs/a")->state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(store_->Get("jobs/a")->model_version(), "models/town/versions/3");
}

TEST_F(SqliteStoreTest, RefusesWritesOfAWorkerWhoseFenceIsOld) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
  const JobLease old = Claim().lease;
  ASSERT_TRUE(store_->Finish(old, To(v1::JOB_STATE_PENDING)).ok());
  EXPECT_TRUE(absl::IsAborted(store_->AddProgress(old, Event(1))));
  const JobLease present = Claim().lease;
  EXPECT_GT(present.fence, old.fence);

  EXPECT_TRUE(absl::IsAborted(store_->AddProgress(old, Event(1))));
  EXPECT_TRUE(absl::IsAborted(store_->Finish(old, To(v1::JOB_STATE_SUCCEEDED))));
  EXPECT_EQ(store_->Get("jobs/a")->state(), v1::JOB_STATE_RUNNING);
  EXPECT_FALSE(store_->Get("jobs/a")->has_progress());

  EXPECT_TRUE(store_->AddProgress(present, Event(1)).ok());
  EXPECT_TRUE(store_->Finish(present, To(v1::JOB_STATE_SUCCEEDED)).ok());
  EXPECT_TRUE(absl::IsAborted(store_->Finish(present, To(v1::JOB_STATE_FAILED))));
  EXPECT_EQ(store_->Get("jobs/a")->state(), v1::JOB_STATE_SUCCEEDED);
}

TEST_F(SqliteStoreTest, ARunThatDoesNotEndKeepsItsLease) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
  const JobLease lease = Claim().lease;
  EXPECT_TRUE(absl::IsFailedPrecondition(store_->Finish(lease, To(v1::JOB_STATE_RUNNING))));
  EXPECT_TRUE(store_->AddProgress(lease, Event(1)).ok());
  EXPECT_TRUE(store_->Finish(lease, To(v1::JOB_STATE_FAILED)).ok());
}

TEST_F(SqliteStoreTest, ACancellationReachesWhoEndsTheRun) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(store_->RequestCancel("jobs/a").status()));
  EXPECT_TRUE(absl::IsNotFound(store_->RequestCancel("jobs/b").status()));
  const ClaimedJob claimed = Claim();
  const auto asked = store_->RequestCancel("jobs/a");
  ASSERT_TRUE(asked.ok()) << asked.status();
  EXPECT_TRUE(asked->cancel_requested());
  const auto end = [](v1::Job& job) {
    EXPECT_TRUE(job.cancel_requested());
    job.set_state(v1::JOB_STATE_CANCELLED);
  };
  EXPECT_TRUE(store_->Finish(claimed.lease, end).ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(store_->RequestCancel("jobs/a").status()));
}

TEST_F(SqliteStoreTest, TakesOverJobsOfAnEarlierProcessAndNoOthers) {
  for (const char* id : {"a", "b"}) ASSERT_TRUE(store_->Add(PendingJob(id), "", "").ok());
  const ClaimedJob abandoned = Claim();
  ASSERT_TRUE(store_->AddProgress(abandoned.lease, Event(1)).ok());
  Reopen();
  const ClaimedJob held = Claim();
  const auto taken = store_->TakeAbandoned(To(v1::JOB_STATE_PENDING));
  ASSERT_TRUE(taken.ok()) << taken.status();
  EXPECT_THAT(NamesOf(*taken), ElementsAre("jobs/a"));
  EXPECT_EQ(taken->front().progress().sequence(), 1);
  EXPECT_EQ(store_->Get("jobs/a")->state(), v1::JOB_STATE_PENDING);
  EXPECT_TRUE(store_->Finish(held.lease, To(v1::JOB_STATE_SUCCEEDED)).ok());
}

// Written by a server that knew no priorities.
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

TEST_F(SqliteStoreTest, ProgressIsReadFromACursorOn) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
  const JobLease lease = Claim().lease;
  for (int i = 1; i <= 5; ++i) ASSERT_TRUE(store_->AddProgress(lease, Event(i)).ok());
  const auto events = store_->ListProgress("jobs/a", 2, 2);
  ASSERT_TRUE(events.ok());
  ASSERT_EQ(events->size(), 2u);
  EXPECT_EQ((*events)[0].sequence(), 3);
  EXPECT_EQ((*events)[1].sequence(), 4);
  EXPECT_THAT(*store_->ListProgress("jobs/a", 5, 10), IsEmpty());
  EXPECT_THAT(*store_->ListProgress("jobs/b", 0, 10), IsEmpty());
}

TEST_F(SqliteStoreTest, AJobThatHasEndedHasNoTimeLeft) {
  v1::JobProgress event = Event(1);
  event.set_fraction(0.7);
  event.mutable_time_left()->set_seconds(9);
  for (const auto& [end, fraction] :
       {std::pair(v1::JOB_STATE_SUCCEEDED, 1.0), std::pair(v1::JOB_STATE_CANCELLED, 0.7)}) {
    const std::string id = fraction == 1.0 ? "a" : "b";
    const v1::Job job = PendingJob(id);
    ASSERT_TRUE(store_->Add(job, "", "").ok());
    const JobLease lease = Claim().lease;
    ASSERT_TRUE(store_->AddProgress(lease, event).ok());
    EXPECT_EQ(store_->Get(job.name())->progress().time_left().seconds(), 9);
    ASSERT_TRUE(store_->Finish(lease, To(end)).ok());
    const auto ended = store_->Get(job.name());
    ASSERT_TRUE(ended.ok()) << ended.status();
    EXPECT_FALSE(ended->progress().has_time_left());
    EXPECT_EQ(ended->progress().fraction(), fraction);
  }
}

TEST_F(SqliteStoreTest, AnEndedJobIsForgottenWithItsProgressAndAnotherIsNot) {
  const v1::Job job = PendingJob("a");
  ASSERT_TRUE(store_->Add(job, "request", "").ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(store_->Delete("jobs/a")));
  const JobLease lease = Claim().lease;
  ASSERT_TRUE(store_->AddProgress(lease, Event(1)).ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(store_->Delete("jobs/a")));
  ASSERT_TRUE(store_->Finish(lease, To(v1::JOB_STATE_CANCELLED)).ok());
  ASSERT_TRUE(store_->Delete("jobs/a").ok());
  EXPECT_TRUE(absl::IsNotFound(store_->Get("jobs/a").status()));
  EXPECT_TRUE(absl::IsNotFound(store_->Delete("jobs/a")));
  // Nothing of it comes back with a job of the same name.
  ASSERT_TRUE(store_->Add(job, "request", "").ok());
  EXPECT_FALSE(store_->Get("jobs/a")->has_progress());
}

TEST_F(SqliteStoreTest, AliasesAreMovedListedAndRemoved) {
  ASSERT_TRUE(store_->SetAlias({"town", "serving"}, 1).ok());
  ASSERT_TRUE(store_->SetAlias({"town", "candidate"}, 2).ok());
  ASSERT_TRUE(store_->SetAlias({"town", "serving"}, 2).ok());
  const auto aliases = store_->ListAliases();
  ASSERT_TRUE(aliases.ok());
  ASSERT_EQ(aliases->size(), 2u);
  EXPECT_EQ((*aliases)[0].name.alias, "candidate");
  EXPECT_EQ((*aliases)[1].version, 2);
  ASSERT_TRUE(store_->DeleteAlias({"town", "serving"}).ok());
  EXPECT_TRUE(absl::IsNotFound(store_->DeleteAlias({"town", "serving"})));
  EXPECT_TRUE(absl::IsNotFound(store_->GetAlias({"town", "serving"}).status()));
}

// As deploy/backup.sh does.
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

TEST_F(SqliteStoreTest, ManyThreadsMayUseIt) {
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([this, t] {
      for (int i = 0; i < 10; ++i) {
        const std::string id = std::to_string(t) + "-" + std::to_string(i);
        EXPECT_TRUE(store_->Add(PendingJob(id), id, "").ok());
        // Perhaps another thread's job.
        const ClaimedJob claimed = Claim();
        EXPECT_TRUE(store_->AddProgress(claimed.lease, Event(1)).ok());
        EXPECT_EQ(store_->Get(claimed.job.name())->progress().sequence(), 1);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(*store_->CountInState(v1::JOB_STATE_RUNNING), 40);
}

}  // namespace
}  // namespace maneuver::jobs::sqlite_store_test
