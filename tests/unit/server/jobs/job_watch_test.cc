#include "server/jobs/job_watch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "server/store/sqlite_store.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::jobs::job_watch_test {
namespace {

v1::Job PendingJob(const std::string& id) {
  v1::Job job;
  job.set_name("jobs/" + id);
  job.set_state(v1::JOB_STATE_PENDING);
  job.mutable_train()->set_model("models/town");
  return job;
}

v1::JobProgress Event(int64_t sequence) {
  v1::JobProgress progress;
  progress.set_sequence(sequence);
  return progress;
}

class JobNewsTest : public testing::Test {
 protected:
  JobNewsTest() { EXPECT_TRUE(store_->Add(PendingJob("a"), "", "").ok()); }

  std::shared_ptr<const JobRead> Read(int64_t after_sequence) {
    const auto read = news_.Read(*store_, "jobs/a", after_sequence, 10);
    EXPECT_TRUE(read.ok()) << read.status();
    return read.ok() ? *read : nullptr;
  }

  const TemporaryFolder folder_;
  const std::unique_ptr<store::SqliteStore> store_ =
      *store::SqliteStore::Open(folder_ / "maneuver.db");
  JobNews news_;
};

TEST_F(JobNewsTest, ListenersWhoAreEquallyFarShareOneReadUntilThereIsNews) {
  const auto listener = news_.Subscribe("jobs/a", [] {});
  const auto first = Read(0);
  EXPECT_EQ(Read(0), first);
  EXPECT_EQ(Read(1), first);  // nothing follows what the first one read
  EXPECT_NE(news_.Read(*store_, "jobs/a", 0, 5).value(), first);
  const auto before = Read(0);
  news_.Publish("jobs/b");
  EXPECT_EQ(Read(0), before);
  news_.Publish("jobs/a");
  const auto after = Read(0);
  EXPECT_NE(after, before);
  news_.PublishAll();
  EXPECT_NE(Read(0), after);
}

TEST_F(JobNewsTest, AReadThatIsCutShortAnswersNoLaterOne) {
  const auto claimed = store_->Claim([](v1::Job&) {});
  ASSERT_TRUE(claimed.ok() && *claimed) << claimed.status();
  for (int64_t sequence = 1; sequence <= 3; ++sequence) {
    ASSERT_TRUE(store_->AddProgress((*claimed)->lease, Event(sequence)).ok());
  }
  const auto listener = news_.Subscribe("jobs/a", [] {});
  const auto first = news_.Read(*store_, "jobs/a", 0, 2);
  const auto second = news_.Read(*store_, "jobs/a", 2, 2);
  ASSERT_TRUE(first.ok() && second.ok());
  ASSERT_EQ((*second)->events.size(), 1u);
  EXPECT_EQ((*second)->events[0].sequence(), 3);
  // Each reader gets each event once, however the reads are shared.
  for (const int64_t after : {0, 1, 2, 3}) {
    JobEventReader reader(*store_, news_, "jobs/a", after);
    int64_t last = after;
    for (;;) {
      const auto events = reader.Next(2);
      ASSERT_TRUE(events.ok()) << events.status();
      if (events->empty()) break;
      for (const v1::Job& event : *events) EXPECT_EQ(event.progress().sequence(), ++last);
    }
    EXPECT_EQ(last, 3);
  }
}

TEST_F(JobNewsTest, ALateReaderGetsWhatATaggingMadeOnlyWithItsEnd) {
  const auto claimed = store_->Claim([](v1::Job&) {});
  ASSERT_TRUE(claimed.ok() && *claimed) << claimed.status();
  ASSERT_TRUE(store_->AddProgress((*claimed)->lease, Event(1)).ok());
  const auto end = [](v1::Job& job) {
    job.set_state(v1::JOB_STATE_SUCCEEDED);
    job.mutable_tagged()->set_name("tags/june");
  };
  ASSERT_TRUE(store_->Finish((*claimed)->lease, end).ok());
  JobEventReader reader(*store_, news_, "jobs/a", 0);
  const auto events = reader.Next(10);
  ASSERT_TRUE(events.ok()) << events.status();
  ASSERT_EQ(events->size(), 2u);
  EXPECT_FALSE(events->front().has_tagged());  // as for who watched it run
  EXPECT_EQ(events->back().tagged().name(), "tags/june");
}

TEST_F(JobNewsTest, AnErrorIsNotShared) {
  const auto listener = news_.Subscribe("jobs/b", [] {});
  EXPECT_TRUE(absl::IsNotFound(news_.Read(*store_, "jobs/b", 0, 10).status()));
  ASSERT_TRUE(store_->Add(PendingJob("b"), "", "").ok());
  EXPECT_TRUE(news_.Read(*store_, "jobs/b", 0, 10).ok());
}

TEST_F(JobNewsTest, KnowsTheJobsThatSomebodyWatches) {
  EXPECT_THAT(news_.Watched(), testing::IsEmpty());
  auto first = news_.Subscribe("jobs/a", [] {});
  auto second = news_.Subscribe("jobs/a", [] {});
  const auto other = news_.Subscribe("jobs/b", [] {});
  EXPECT_THAT(news_.Watched(), testing::ElementsAre("jobs/a", "jobs/b"));
  first.reset();
  EXPECT_THAT(news_.Watched(), testing::ElementsAre("jobs/a", "jobs/b"));
  second.reset();
  EXPECT_THAT(news_.Watched(), testing::ElementsAre("jobs/b"));
}

}  // namespace
}  // namespace maneuver::jobs::job_watch_test
