#include "server/jobs/progress_recorder.h"

#include <gtest/gtest.h>

#include <memory>

#include "server/jobs/sqlite_store.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::jobs::progress_recorder_test {
namespace {

class ProgressRecorderTest : public testing::Test {
 protected:
  ProgressRecorderTest() {
    store_ = *SqliteStore::Open(folder_ / "maneuver.db");
    v1::Job job;
    job.set_name("jobs/a");
    job.set_state(v1::JOB_STATE_PENDING);
    job.mutable_attempts()->set_started(1);
    EXPECT_TRUE(store_->Add(job, "", "").ok());
    lease_ = (**store_->Claim([](v1::Job&) {})).lease;
    StartProcess(job);
  }

  void StartProcess(const v1::Job& job) {
    recorder_ =
        std::make_unique<ProgressRecorder>(*store_, news_, job, lease_, [this] { return now_; });
  }

  void Step(int step) {
    recorder_->Record("{\"phase\":\"joint\",\"step\":" + std::to_string(step) + "}");
  }
  std::vector<int64_t> Steps() {
    std::vector<int64_t> steps;
    const auto events = store_->ListProgress("jobs/a", 0, 1000);
    for (const v1::JobProgress& event : *events) {
      steps.push_back(event.step());
      EXPECT_EQ(event.sequence(), static_cast<int64_t>(steps.size()));
    }
    return steps;
  }

  const TemporaryFolder folder_;
  std::unique_ptr<SqliteStore> store_;
  JobLease lease_;
  JobNews news_;
  absl::Time now_ = absl::FromUnixSeconds(1'000);
  std::unique_ptr<ProgressRecorder> recorder_;
};

TEST_F(ProgressRecorderTest, AFloodBecomesFiveEventsPerSecondAndKeepsTheLast) {
  for (int step = 1; step <= 1'000; ++step) {
    Step(step);
    now_ += absl::Milliseconds(1);
  }
  recorder_->Flush();
  EXPECT_EQ(Steps(), (std::vector<int64_t>{1, 201, 401, 601, 801, 1000}));
}

TEST_F(ProgressRecorderTest, NeverLeavesOutTheEndOfAnEpochOrANewPhase) {
  Step(1);
  recorder_->Record(R"({"phase":"joint","step":"2","epochReport":{"effectiveActions":8}})");
  recorder_->Record(R"({"phase":"export","step":"3"})");
  EXPECT_EQ(Steps(), (std::vector<int64_t>{1, 2, 3}));
}

TEST_F(ProgressRecorderTest, StoresAWaitingEventWithinTheInterval) {
  Step(1);
  Step(2);
  recorder_->Tick();
  EXPECT_EQ(Steps(), (std::vector<int64_t>{1}));
  now_ += absl::Milliseconds(200);
  recorder_->Tick();
  recorder_->Tick();
  EXPECT_EQ(Steps(), (std::vector<int64_t>{1, 2}));
}

TEST_F(ProgressRecorderTest, NeverStoresAnEventAfterALaterOne) {
  Step(1);
  Step(2);
  recorder_->Record(R"({"phase":"joint","step":"3","epochReport":{}})");
  now_ += absl::Seconds(1);
  recorder_->Tick();
  recorder_->Flush();
  EXPECT_EQ(Steps(), (std::vector<int64_t>{1, 3}));
}

TEST_F(ProgressRecorderTest, TheNextProcessOfTheJobContinuesTheNumbering) {
  Step(1);
  v1::Job job = *store_->Get("jobs/a");
  job.mutable_attempts()->set_started(2);
  StartProcess(job);
  Step(2);
  EXPECT_EQ(Steps(), (std::vector<int64_t>{1, 2}));
  const auto events = *store_->ListProgress("jobs/a", 0, 10);
  EXPECT_EQ(events[0].attempt(), 1);
  EXPECT_EQ(events[1].attempt(), 2);
}

TEST_F(ProgressRecorderTest, StoresNothingOnceTheLeaseHasEnded) {
  Step(1);
  const auto end = [](v1::Job& job) { job.set_state(v1::JOB_STATE_PENDING); };
  ASSERT_TRUE(store_->Finish(lease_, end).ok());
  now_ += absl::Seconds(1);
  Step(2);
  EXPECT_EQ(Steps(), (std::vector<int64_t>{1}));
}

TEST_F(ProgressRecorderTest, SkipsLinesThatAreNotAMessage) {
  for (const char* line : {"", "hello", "{", "[1]", "{\"step\":\"x\"}", "\xff\xfe"}) {
    recorder_->Record(line);
  }
  recorder_->Record("{\"step\":\"7\",\"a field of tomorrow\":1}");
  EXPECT_EQ(Steps(), (std::vector<int64_t>{7}));
}

}  // namespace
}  // namespace maneuver::jobs::progress_recorder_test
