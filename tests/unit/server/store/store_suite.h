// The behaviour of a store, whatever database it uses. A test program includes this file, and says
// which database:
//   INSTANTIATE_TEST_SUITE_P(Sqlite, StoreTest, testing::Values(&OpenSqlite));

#ifndef MANEUVER_TESTS_UNIT_SERVER_STORE_STORE_SUITE_H_
#define MANEUVER_TESTS_UNIT_SERVER_STORE_STORE_SUITE_H_

#include <gmock/gmock.h>
#include <google/protobuf/util/message_differencer.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "server/store/store.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::store {

inline v1::Job PendingJob(const std::string& id) {
  v1::Job job;
  job.set_name("jobs/" + id);
  job.set_state(v1::JOB_STATE_PENDING);
  job.mutable_train()->set_model("models/town");
  job.mutable_create_time()->set_seconds(1000);
  return job;
}

inline v1::Job InState(v1::Job job, v1::JobState state) {
  job.set_state(state);
  return job;
}

inline jobs::JobEdit To(v1::JobState state) {
  return [state](v1::Job& job) { job.set_state(state); };
}

inline v1::JobProgress Event(int64_t sequence) {
  v1::JobProgress progress;
  progress.set_sequence(sequence);
  progress.set_phase("joint");
  return progress;
}

inline std::vector<std::string> NamesOf(const std::vector<v1::Job>& jobs) {
  std::vector<std::string> names;
  for (const v1::Job& job : jobs) names.push_back(job.name());
  return names;
}

// Makes one store, and opens it again and again.
class StoreMaker {
 public:
  virtual ~StoreMaker() = default;
  // Opens the store, as a server that starts does. The one before is closed.
  virtual absl::StatusOr<std::unique_ptr<Store>> Open() = 0;
  // Runs a statement on the database beside the store.
  virtual absl::Status Run(const std::string& statement) = 0;
};
// Returns a maker of one empty store. NOT_FOUND if the database is not installed.
//   folder: empty, and there as long as the store is used
using NewStore =
    absl::StatusOr<std::unique_ptr<StoreMaker>> (*)(const std::filesystem::path& folder);

class StoreTest : public testing::TestWithParam<NewStore> {
 protected:
  void SetUp() override {
    auto maker = GetParam()(folder_.path());
    if (absl::IsNotFound(maker.status())) GTEST_SKIP() << maker.status().message();
    ASSERT_TRUE(maker.ok()) << maker.status();
    maker_ = *std::move(maker);
    Reopen();
  }

  // Closes and opens the store, as a restart does.
  void Reopen() {
    store_.reset();
    auto store = maker_->Open();
    ASSERT_TRUE(store.ok()) << store.status();
    store_ = *std::move(store);
  }

  jobs::ClaimedJob Claim() {
    const auto claimed = store_->Claim([](v1::Job&) {});
    EXPECT_TRUE(claimed.ok()) << claimed.status();
    if (!claimed.ok() || !*claimed) {
      ADD_FAILURE() << "no job is pending";
      return {};
    }
    return **claimed;
  }

  const TemporaryFolder folder_;
  std::unique_ptr<StoreMaker> maker_;
  std::unique_ptr<Store> store_;
};

TEST_P(StoreTest, JobsProgressAndAliasesSurviveARestart) {
  const v1::Job job = PendingJob("a");
  ASSERT_TRUE(store_->Add(job, "request", "digest").ok());
  const jobs::ClaimedJob claimed = Claim();
  ASSERT_TRUE(store_->AddProgress(claimed.lease, Event(1)).ok());
  ASSERT_TRUE(store_->AddProgress(claimed.lease, Event(2)).ok());
  ASSERT_TRUE(store_->SetAlias({"town", "serving"}, 3).ok());

  Reopen();

  v1::Job expected = InState(job, v1::JOB_STATE_RUNNING);
  *expected.mutable_progress() = Event(2);
  const auto found = store_->Get("jobs/a");
  ASSERT_TRUE(found.ok()) << found.status();
  EXPECT_TRUE(google::protobuf::util::MessageDifferencer::Equals(*found, expected))
      << found->DebugString();
  const auto requested = store_->FindRequest("request");
  ASSERT_TRUE(requested.ok() && requested->has_value());
  EXPECT_EQ((*requested)->job.name(), "jobs/a");
  EXPECT_EQ((*requested)->request_digest, "digest");
  EXPECT_EQ(*store_->GetAlias({"town", "serving"}), 3);
}

TEST_P(StoreTest, ARequestIdBelongsToOneJobAndNoRequestIdToAny) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "request", "").ok());
  EXPECT_TRUE(absl::IsAlreadyExists(store_->Add(PendingJob("b"), "request", "")));
  EXPECT_TRUE(absl::IsNotFound(store_->Get("jobs/b").status()));
  ASSERT_TRUE(store_->Add(PendingJob("c"), "", "").ok());
  EXPECT_TRUE(store_->Add(PendingJob("d"), "", "").ok());
  EXPECT_FALSE(store_->FindRequest("")->has_value());
}

TEST_P(StoreTest, AListLeavesOutADamagedJobAndNamesIt) {
  for (const char* id : {"a", "b", "c", "d"}) {
    ASSERT_TRUE(store_->Add(PendingJob(id), "", "").ok());
  }
  ASSERT_TRUE(maker_->Run("UPDATE jobs SET state = 4 WHERE name = 'jobs/c'").ok());
  const auto all = store_->List(10, "");
  ASSERT_TRUE(all.ok()) << all.status();
  EXPECT_EQ(NamesOf(all->jobs), (std::vector<std::string>{"jobs/d", "jobs/b", "jobs/a"}));
  ASSERT_EQ(all->damaged.size(), 1u);
  EXPECT_EQ(all->damaged[0].name, "jobs/c");
  EXPECT_EQ(all->damaged[0].newer, 1u);  // jobs/d
  EXPECT_TRUE(absl::IsDataLoss(all->damaged[0].error));
  EXPECT_THAT(std::string(all->damaged[0].error.message()), testing::HasSubstr("jobs/c"));
  const auto damaged = store_->Get("jobs/c").status();
  EXPECT_TRUE(absl::IsDataLoss(damaged));
  EXPECT_THAT(std::string(damaged.message()), testing::HasSubstr("jobs/c"));

  const auto first = store_->List(2, "");
  ASSERT_TRUE(first.ok()) << first.status();
  EXPECT_EQ(NamesOf(first->jobs), (std::vector<std::string>{"jobs/d"}));
  const auto second = store_->List(2, first->next_page_token);
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_EQ(NamesOf(second->jobs), (std::vector<std::string>{"jobs/b", "jobs/a"}));
  EXPECT_EQ(second->next_page_token, "");
}

TEST_P(StoreTest, ADamagedJobDoesNotKeepOthersFromRunning) {
  for (const char* id : {"a", "b"}) ASSERT_TRUE(store_->Add(PendingJob(id), "", "").ok());
  ASSERT_TRUE(maker_->Run("UPDATE jobs SET job = '\\x00' WHERE name = 'jobs/a'").ok());
  const auto pending = store_->ListInState(v1::JOB_STATE_PENDING, 1).status();
  EXPECT_TRUE(absl::IsDataLoss(pending)) << pending;
  EXPECT_EQ(Claim().job.name(), "jobs/b");
  const auto none = store_->Claim([](v1::Job&) {});
  ASSERT_TRUE(none.ok()) << none.status();
  EXPECT_FALSE(*none);

  ASSERT_TRUE(maker_->Run("UPDATE jobs SET state = 2 WHERE name = 'jobs/a'").ok());
  Reopen();
  const auto taken = store_->TakeAbandoned(To(v1::JOB_STATE_PENDING));
  ASSERT_TRUE(taken.ok()) << taken.status();
  EXPECT_THAT(NamesOf(*taken), testing::ElementsAre("jobs/b"));
  EXPECT_EQ(Claim().job.name(), "jobs/b");
}

TEST_P(StoreTest, PagesAreNewestFirstWithoutGapsWhileJobsArrive) {
  for (const char* id : {"a", "b", "c", "d", "e"}) {
    ASSERT_TRUE(store_->Add(PendingJob(id), "", "").ok());
  }
  auto page = store_->List(2, "");
  ASSERT_TRUE(page.ok());
  EXPECT_THAT(NamesOf(page->jobs), testing::ElementsAre("jobs/e", "jobs/d"));
  ASSERT_TRUE(store_->Add(PendingJob("f"), "", "").ok());
  page = store_->List(2, page->next_page_token);
  EXPECT_THAT(NamesOf(page->jobs), testing::ElementsAre("jobs/c", "jobs/b"));
  page = store_->List(2, page->next_page_token);
  EXPECT_THAT(NamesOf(page->jobs), testing::ElementsAre("jobs/a"));
  EXPECT_EQ(page->next_page_token, "");
  EXPECT_EQ(store_->List(6, "")->next_page_token, "");
}

TEST_P(StoreTest, AForeignPageTokenIsRefused) {
  for (const char* token : {"x", "-1", "0", "1 or 1"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(store_->List(2, token).status())) << token;
  }
}

TEST_P(StoreTest, OfTwoWhoMoveAJobOneWins) {
  const v1::Job job = PendingJob("a");
  ASSERT_TRUE(store_->Add(job, "", "").ok());
  EXPECT_TRUE(store_->Move(v1::JOB_STATE_PENDING, InState(job, v1::JOB_STATE_CANCELLED)).ok());
  const absl::Status late =
      store_->Move(v1::JOB_STATE_PENDING, InState(job, v1::JOB_STATE_CANCELLED));
  EXPECT_TRUE(absl::IsFailedPrecondition(late)) << late;
  EXPECT_THAT(std::string(late.message()), testing::HasSubstr("cancelled"));
  EXPECT_EQ(store_->Get("jobs/a")->state(), v1::JOB_STATE_CANCELLED);
}

TEST_P(StoreTest, AForbiddenMoveChangesNothing) {
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

TEST_P(StoreTest, JobsInAStateComeOldestFirst) {
  for (const char* id : {"a", "b", "c"}) ASSERT_TRUE(store_->Add(PendingJob(id), "", "").ok());
  ASSERT_TRUE(
      store_->Move(v1::JOB_STATE_PENDING, InState(PendingJob("b"), v1::JOB_STATE_CANCELLED)).ok());
  EXPECT_THAT(NamesOf(*store_->ListInState(v1::JOB_STATE_PENDING, std::nullopt)),
              testing::ElementsAre("jobs/a", "jobs/c"));
  EXPECT_THAT(NamesOf(*store_->ListInState(v1::JOB_STATE_PENDING, 1)),
              testing::ElementsAre("jobs/a"));
  EXPECT_EQ(*store_->CountInState(v1::JOB_STATE_PENDING), 2);
  EXPECT_EQ(*store_->CountInState(v1::JOB_STATE_FAILED), 0);
}

TEST_P(StoreTest, AHigherPriorityGoesBeforeAgeAndSurvivesARestart) {
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
              testing::ElementsAre("jobs/e", "jobs/b", "jobs/d", "jobs/a", "jobs/c"));
}

TEST_P(StoreTest, ClaimsTheMostUrgentJobAndThenTheOldest) {
  int priorities[] = {0, 5, 5};
  for (int i = 0; i < 3; ++i) {
    v1::Job job = PendingJob(std::string(1, static_cast<char>('a' + i)));
    job.mutable_train()->set_priority(priorities[i]);
    ASSERT_TRUE(store_->Add(job, "", "").ok());
  }
  for (const char* name : {"jobs/b", "jobs/c", "jobs/a"}) {
    const jobs::ClaimedJob claimed = Claim();
    EXPECT_EQ(claimed.job.name(), name);
    EXPECT_EQ(claimed.job.state(), v1::JOB_STATE_RUNNING);
    EXPECT_EQ(claimed.lease.job, name);
    EXPECT_EQ(store_->Get(name)->state(), v1::JOB_STATE_RUNNING);
  }
  const auto none = store_->Claim([](v1::Job&) { ADD_FAILURE() << "no job is left"; });
  ASSERT_TRUE(none.ok()) << none.status();
  EXPECT_FALSE(none->has_value());
}

TEST_P(StoreTest, StoresWhatChangesAsAJobBeginsAndEnds) {
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

TEST_P(StoreTest, RefusesWritesOfAWorkerWhoseFenceIsOld) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
  const jobs::JobLease old = Claim().lease;
  ASSERT_TRUE(store_->Finish(old, To(v1::JOB_STATE_PENDING)).ok());
  EXPECT_TRUE(absl::IsAborted(store_->AddProgress(old, Event(1))));
  const jobs::JobLease present = Claim().lease;
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

TEST_P(StoreTest, ARunThatDoesNotEndKeepsItsLease) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
  const jobs::JobLease lease = Claim().lease;
  EXPECT_TRUE(absl::IsFailedPrecondition(store_->Finish(lease, To(v1::JOB_STATE_RUNNING))));
  EXPECT_TRUE(store_->AddProgress(lease, Event(1)).ok());
  EXPECT_TRUE(store_->Finish(lease, To(v1::JOB_STATE_FAILED)).ok());
}

TEST_P(StoreTest, ACancellationReachesWhoEndsTheRun) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(store_->RequestCancel("jobs/a").status()));
  EXPECT_TRUE(absl::IsNotFound(store_->RequestCancel("jobs/b").status()));
  const jobs::ClaimedJob claimed = Claim();
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

TEST_P(StoreTest, TakesOverJobsOfAnEarlierProcessAndNoOthers) {
  for (const char* id : {"a", "b"}) ASSERT_TRUE(store_->Add(PendingJob(id), "", "").ok());
  const jobs::ClaimedJob abandoned = Claim();
  ASSERT_TRUE(store_->AddProgress(abandoned.lease, Event(1)).ok());
  Reopen();
  const jobs::ClaimedJob held = Claim();
  const auto taken = store_->TakeAbandoned(To(v1::JOB_STATE_PENDING));
  ASSERT_TRUE(taken.ok()) << taken.status();
  EXPECT_THAT(NamesOf(*taken), testing::ElementsAre("jobs/a"));
  EXPECT_EQ(taken->front().progress().sequence(), 1);
  EXPECT_EQ(store_->Get("jobs/a")->state(), v1::JOB_STATE_PENDING);
  EXPECT_TRUE(store_->Finish(held.lease, To(v1::JOB_STATE_SUCCEEDED)).ok());
}

TEST_P(StoreTest, ProgressIsReadFromACursorOn) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
  const jobs::JobLease lease = Claim().lease;
  for (int i = 1; i <= 5; ++i) ASSERT_TRUE(store_->AddProgress(lease, Event(i)).ok());
  const auto events = store_->ListProgress("jobs/a", 2, 2);
  ASSERT_TRUE(events.ok());
  ASSERT_EQ(events->size(), 2u);
  EXPECT_EQ((*events)[0].sequence(), 3);
  EXPECT_EQ((*events)[1].sequence(), 4);
  EXPECT_THAT(*store_->ListProgress("jobs/a", 5, 10), testing::IsEmpty());
  EXPECT_THAT(*store_->ListProgress("jobs/b", 0, 10), testing::IsEmpty());
}

TEST_P(StoreTest, NamesAnEventThatIsInAnotherPlaceThanItsOwn) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
  const jobs::JobLease lease = Claim().lease;
  for (int i = 1; i <= 2; ++i) ASSERT_TRUE(store_->AddProgress(lease, Event(i)).ok());
  ASSERT_TRUE(maker_->Run("UPDATE progress SET sequence = 34 WHERE sequence = 2").ok());
  EXPECT_TRUE(absl::IsDataLoss(store_->ListProgress("jobs/a", 0, 10).status()));
}

TEST_P(StoreTest, AJobThatHasEndedHasNoTimeLeft) {
  v1::JobProgress event = Event(1);
  event.set_fraction(0.7);
  event.mutable_time_left()->set_seconds(9);
  for (const auto& [end, fraction] :
       {std::pair(v1::JOB_STATE_SUCCEEDED, 1.0), std::pair(v1::JOB_STATE_CANCELLED, 0.7)}) {
    const std::string id = fraction == 1.0 ? "a" : "b";
    const v1::Job job = PendingJob(id);
    ASSERT_TRUE(store_->Add(job, "", "").ok());
    const jobs::JobLease lease = Claim().lease;
    ASSERT_TRUE(store_->AddProgress(lease, event).ok());
    EXPECT_EQ(store_->Get(job.name())->progress().time_left().seconds(), 9);
    ASSERT_TRUE(store_->Finish(lease, To(end)).ok());
    const auto ended = store_->Get(job.name());
    ASSERT_TRUE(ended.ok()) << ended.status();
    EXPECT_FALSE(ended->progress().has_time_left());
    EXPECT_EQ(ended->progress().fraction(), fraction);
  }
}

TEST_P(StoreTest, AnEndedJobIsForgottenWithItsProgressAndAnotherIsNot) {
  const v1::Job job = PendingJob("a");
  ASSERT_TRUE(store_->Add(job, "request", "").ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(store_->Delete("jobs/a")));
  const jobs::JobLease lease = Claim().lease;
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

TEST_P(StoreTest, RenewingALeaseTellsThatTheJobIsToBeCancelled) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
  const jobs::JobLease lease = Claim().lease;
  EXPECT_EQ(*store_->Renew(lease), false);
  ASSERT_TRUE(store_->RequestCancel("jobs/a").ok());
  EXPECT_EQ(*store_->Renew(lease), true);
  ASSERT_TRUE(store_->Finish(lease, To(v1::JOB_STATE_CANCELLED)).ok());
  EXPECT_TRUE(absl::IsAborted(store_->Renew(lease).status()));
}

TEST_P(StoreTest, AnAliasMovesOnlyFromWhereItIsExpected) {
  const security::ModelAliasName serving{"town", "serving"};
  EXPECT_FALSE(*store_->SetAliasIf(serving, 2, {.before = 1, .maker = {}}));
  EXPECT_TRUE(absl::IsNotFound(store_->GetAlias(serving).status()));
  EXPECT_TRUE(*store_->SetAliasIf(serving, 1, {.before = 0, .maker = {}}));
  EXPECT_FALSE(*store_->SetAliasIf(serving, 2, {.before = 0, .maker = {}}));
  EXPECT_FALSE(*store_->SetAliasIf(serving, 2, {.before = 3, .maker = {}}));
  EXPECT_EQ(*store_->GetAlias(serving), 1);
  EXPECT_TRUE(*store_->SetAliasIf(serving, 2, {.before = 1, .maker = {}}));
  EXPECT_EQ(*store_->GetAlias(serving), 2);
}

TEST_P(StoreTest, AJobWhoseLeaseHasEndedMovesNoAlias) {
  ASSERT_TRUE(store_->Add(PendingJob("a"), "", "").ok());
  const jobs::JobLease lease = Claim().lease;
  const serving::AliasCondition by_job = {.before = std::nullopt, .maker = {"jobs/a", lease.fence}};
  EXPECT_TRUE(*store_->SetAliasIf({"town", "serving"}, 1, by_job));
  ASSERT_TRUE(store_->Finish(lease, To(v1::JOB_STATE_PENDING)).ok());
  Claim();
  EXPECT_TRUE(absl::IsAborted(store_->SetAliasIf({"town", "serving"}, 2, by_job).status()));
  EXPECT_EQ(*store_->GetAlias({"town", "serving"}), 1);
}

TEST_P(StoreTest, AliasesAreMovedListedAndRemoved) {
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

TEST_P(StoreTest, ListsHowFarJobsAre) {
  for (const char* id : {"a", "b", "c"}) ASSERT_TRUE(store_->Add(PendingJob(id), "", "").ok());
  const auto claimed = store_->Claim([](v1::Job&) {});
  ASSERT_TRUE(claimed.ok() && *claimed) << claimed.status();
  ASSERT_TRUE(store_->AddProgress((*claimed)->lease, Event(3)).ok());
  ASSERT_TRUE(store_->AddProgress((*claimed)->lease, Event(5)).ok());
  const auto positions = store_->ListPositions({"jobs/a", "jobs/c", "jobs/x\"y\\"});
  ASSERT_TRUE(positions.ok()) << positions.status();
  EXPECT_THAT(*positions,
              testing::UnorderedElementsAre(jobs::JobPosition{"jobs/a", v1::JOB_STATE_RUNNING, 5},
                                            jobs::JobPosition{"jobs/c", v1::JOB_STATE_PENDING, 0}));
}

TEST_P(StoreTest, ManyThreadsMayUseIt) {
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([this, t] {
      for (int i = 0; i < 10; ++i) {
        const std::string id = std::to_string(t) + "-" + std::to_string(i);
        EXPECT_TRUE(store_->Add(PendingJob(id), id, "").ok());
        // Perhaps another thread's job.
        const jobs::ClaimedJob claimed = Claim();
        EXPECT_TRUE(store_->AddProgress(claimed.lease, Event(1)).ok());
        EXPECT_EQ(store_->Get(claimed.job.name())->progress().sequence(), 1);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(*store_->CountInState(v1::JOB_STATE_RUNNING), 40);
}

}  // namespace maneuver::store

#endif  // MANEUVER_TESTS_UNIT_SERVER_STORE_STORE_SUITE_H_
