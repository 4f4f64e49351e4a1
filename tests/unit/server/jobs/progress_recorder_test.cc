#include "server/jobs/progress_recorder.h"

#include <gtest/gtest.h>

#include <memory>

#include "server/jobs/job_time.h"
#include "server/store/sqlite_store.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::jobs::progress_recorder_test {
namespace {

class ProgressRecorderTest : public testing::Test {
 protected:
  ProgressRecorderTest() {
    store_ = *store::SqliteStore::Open(folder_ / "maneuver.db");
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
  std::unique_ptr<store::SqliteStore> store_;
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

TEST_F(ProgressRecorderTest, GoesOnWhenTheClockIsSetBack) {
  Step(1);
  now_ -= absl::Hours(1);
  Step(2);
  Step(3);
  EXPECT_EQ(Steps(), (std::vector<int64_t>{1, 2}));
  now_ += absl::Milliseconds(200);
  recorder_->Tick();
  EXPECT_EQ(Steps(), (std::vector<int64_t>{1, 2, 3}));
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

TEST_F(ProgressRecorderTest, TheRestOfAJobIsSharedByTheRunsThatFollow) {
  const auto record = [this](double fraction, int64_t left) {
    now_ += absl::Seconds(1);
    recorder_->Record("{\"phase\":\"evaluate\",\"fraction\":" + std::to_string(fraction) +
                      ",\"timeLeft\":\"" + std::to_string(left) + "s\"}");
    return store_->ListProgress("jobs/a", 0, 1000)->back();
  };
  EXPECT_DOUBLE_EQ(record(0.6, 7).fraction(), 0.6);
  recorder_->SetRest(2);
  EXPECT_EQ(record(0.0, 9).time_left().seconds(), 9 + 10);  // a second has passed
  EXPECT_DOUBLE_EQ(record(0.5, 4).fraction(), 0.7);
  EXPECT_EQ(record(0.75, 1).time_left().seconds(), 1 + 4);
  recorder_->SetRest(1);  // although the last report was of three quarters
  EXPECT_DOUBLE_EQ(record(0.0, 3).fraction(), 0.8);
  EXPECT_EQ(record(0.5, 2).time_left().seconds(), 2);
  EXPECT_DOUBLE_EQ(record(1.0, 0).fraction(), 1.0);
}

TEST_F(ProgressRecorderTest, TheTimeLeftOfSeveralRunsIsNotRounded) {
  recorder_->SetRest(3);
  now_ += absl::Milliseconds(600);
  recorder_->Record(R"({"phase":"evaluate","fraction":0.2,"timeLeft":"1.400s"})");
  const v1::JobProgress progress = store_->ListProgress("jobs/a", 0, 10)->back();
  EXPECT_EQ(ToDuration(progress.time_left()), absl::Milliseconds(1400 + 2 * (600 + 1400)));
}

TEST_F(ProgressRecorderTest, TheTimeLeftGoesDownUntilTheNextRunReportsOne) {
  const auto left = [this](const std::string& report) {
    recorder_->Record(report);
    recorder_->Flush();
    const v1::JobProgress progress = store_->ListProgress("jobs/a", 0, 10)->back();
    return progress.has_time_left() ? ToDuration(progress.time_left()) : absl::InfiniteDuration();
  };
  EXPECT_EQ(left(R"({"phase":"load"})"), absl::InfiniteDuration());
  EXPECT_EQ(left(R"({"phase":"joint","timeLeft":"4s"})"), absl::Seconds(4));
  recorder_->SetRest(1);
  now_ += absl::Seconds(1.5);
  EXPECT_EQ(left(R"({"phase":"load"})"), absl::Seconds(2.5));
  now_ += absl::Seconds(3);
  EXPECT_EQ(left(R"({"phase":"evaluate"})"), absl::ZeroDuration());
  EXPECT_EQ(left(R"({"phase":"evaluate","timeLeft":"2s"})"), absl::Seconds(2));
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
