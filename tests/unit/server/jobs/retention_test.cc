#include "server/jobs/retention.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <algorithm>

#include "server/jobs/job_time.h"
#include "tests/unit/server/jobs/supervisor_fixture.h"

namespace maneuver::jobs::retention_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::IsEmpty;

std::vector<serving::ModelVersions::ListedVersion> TownAndCity() {  // newest first
  return {{{"town", 4}, false},
          {{"city", 1}, false},
          {{"town", 3}, false},
          {{"town", 2}, true},
          {{"town", 1}, false}};
}

std::vector<std::string> Deleted(const RetentionPolicy& policy,
                                 const std::set<std::string>& needed = {}) {
  std::vector<std::string> names;
  for (const auto& name : VersionsToDelete(policy, TownAndCity(), needed)) {
    names.push_back(name.ToString());
  }
  return names;
}

TEST(VersionsToDeleteTest, KeepsTheNewestVersionsOfEachModel) {
  EXPECT_THAT(Deleted({.versions = 2}), ElementsAre("models/town/versions/1"));
}

// A version whose file cannot be looked at comes last, as if it were of 1970.
TEST(VersionsToDeleteTest, TheNewestVersionIsTheOneWithTheLargestNumber) {
  const auto deleted = VersionsToDelete(
      {.versions = 1}, {{{"town", 1}, false}, {{"town", 2}, false}, {{"town", 3}, false}}, {});
  ASSERT_EQ(deleted.size(), 2u);
  EXPECT_EQ(deleted[0].version, 1);
  EXPECT_EQ(deleted[1].version, 2);
}

TEST(VersionsToDeleteTest, KeepsVersionsWithAnAlias) {
  EXPECT_THAT(Deleted({.versions = 1}),
              ElementsAre("models/town/versions/3", "models/town/versions/1"));
}

TEST(VersionsToDeleteTest, KeepsVersionsThatAJobReads) {
  EXPECT_THAT(Deleted({.versions = 1}, {"models/town/versions/3"}),
              ElementsAre("models/town/versions/1"));
}

TEST(VersionsToDeleteTest, KeepsVersionsThatAJobHasMade) {
  const std::vector<serving::ModelVersions::ListedVersion> versions = {
      {{"town", 3}, false, "jobs/c"}, {{"town", 2}, false, "jobs/b"}, {{"town", 1}, false}};
  const auto deleted = VersionsToDelete({.versions = 1}, versions, {"jobs/b"});
  ASSERT_EQ(deleted.size(), 1u);
  EXPECT_EQ(deleted[0].version, 1);
}

TEST(VersionsToDeleteTest, KeepsAllVersionsWithoutALimit) { EXPECT_THAT(Deleted({}), IsEmpty()); }

class RetentionTest : public SupervisorTest {
 protected:
  RetentionTest() { versions_.listed = TownAndCity(); }

  // A job that ended so long ago, with a checkpoint.
  void AddEnded(const std::string& id, v1::JobState state, absl::Duration age) {
    v1::Job job;
    job.set_name("jobs/" + id);
    *job.mutable_train() = TrainTown();
    job.set_state(v1::JOB_STATE_PENDING);
    ASSERT_TRUE(store_->Add(job, "", "").ok());
    const auto claimed = store_->Claim([](v1::Job&) {});
    ASSERT_TRUE(claimed.ok() && *claimed) << claimed.status();
    const auto end = [&](v1::Job& ended) {
      ended.set_state(state);
      *ended.mutable_end_time() = ToTimestamp(now_ - age);
    };
    ASSERT_TRUE(store_->Finish((*claimed)->lease, end).ok());
    fs::create_directories(FolderOf(job) / "checkpoints");
    std::ofstream(FolderOf(job) / "checkpoints" / "checkpoint-000001") << "x";
  }
  // Overwrites the row of a job.
  void Damage(const std::string& id) {
    sqlite3* database = nullptr;
    ASSERT_EQ(sqlite3_open((folder_ / "maneuver.db").c_str(), &database), SQLITE_OK);
    const std::string statement = "UPDATE jobs SET job = x'00' WHERE name = 'jobs/" + id + "'";
    EXPECT_EQ(sqlite3_exec(database, statement.c_str(), nullptr, nullptr, nullptr), SQLITE_OK);
    sqlite3_close(database);
  }
  bool HasJob(const std::string& id) { return store_->Get("jobs/" + id).ok(); }
  bool HasCheckpoints(const std::string& id) { return LastCheckpoint(folder_ / "jobs" / id) > 0; }

  const absl::Time now_ = absl::Now();
};

TEST_F(RetentionTest, RemovesOldJobsAndOldCheckpoints) {
  AddEnded("ancient", v1::JOB_STATE_SUCCEEDED, absl::Hours(24 * 91));
  AddEnded("old", v1::JOB_STATE_FAILED, absl::Hours(24 * 15));
  AddEnded("old-cancelled", v1::JOB_STATE_CANCELLED, absl::Hours(24 * 15));
  AddEnded("recent", v1::JOB_STATE_CANCELLED, absl::Hours(24 * 13));
  Start();
  Retention retention({.versions = 1}, *supervisor_, versions_);
  ASSERT_TRUE(retention.Sweep(now_).ok());
  EXPECT_FALSE(HasJob("ancient"));
  EXPECT_FALSE(fs::exists(folder_ / "jobs" / "ancient"));
  EXPECT_TRUE(HasJob("old") && HasJob("old-cancelled") && HasJob("recent"));
  EXPECT_FALSE(HasCheckpoints("old") || HasCheckpoints("old-cancelled"));
  EXPECT_TRUE(HasCheckpoints("recent"));
  EXPECT_EQ(versions_.List().size(), 3u);
}

TEST_F(RetentionTest, RemovesOldJobsBesideADamagedOne) {
  AddEnded("ancient", v1::JOB_STATE_SUCCEEDED, absl::Hours(24 * 91));
  AddEnded("damaged", v1::JOB_STATE_SUCCEEDED, absl::Hours(24 * 91));
  Damage("damaged");
  Start();
  Retention retention({}, *supervisor_, versions_);
  const absl::Status status = retention.Sweep(now_);
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("jobs/damaged"));
  EXPECT_FALSE(HasJob("ancient"));
  EXPECT_TRUE(fs::exists(folder_ / "jobs" / "damaged"));
}

TEST_F(RetentionTest, KeepsJobsThatHaveNotEnded) {
  Trainer("mkdir -p \"$checkpoints\"; touch \"$checkpoints/checkpoint-000001\"\n" +
          std::string(kRunsOn));
  Start();
  const std::string running = Train().name();
  WaitForProgress(running);
  const std::string pending = Train().name();
  fs::create_directories(folder_ / pending / "checkpoints");
  std::ofstream(folder_ / pending / "checkpoints" / "checkpoint-000001") << "x";
  Retention retention({.jobs = absl::ZeroDuration(), .checkpoints = absl::ZeroDuration()},
                      *supervisor_, versions_);
  ASSERT_TRUE(retention.Sweep(now_ + absl::Hours(1'000)).ok());
  for (const std::string& job : {running, pending}) {
    EXPECT_TRUE(store_->Get(job).ok());
    EXPECT_EQ(LastCheckpoint(folder_ / job), 1);
    EXPECT_FALSE(*supervisor_->DropCheckpoints(job));
  }
}

TEST_F(RetentionTest, KeepsTheVersionThatARunningJobHasMadeAndMeasures) {
  versions_.serving = security::ModelVersionName{"town", 9};
  Trainer("[ $command = train ] && { mkdir \"$output\"; exit 0; }\n" + std::string(kRunsOn));
  Start();
  v1::TrainRequest request = TrainTown();
  request.set_promotion(v1::PROMOTION_IF_NO_WORSE);
  request.mutable_promotion_criteria()->set_dataset("datasets/village");
  const std::string job = Train(request).name();
  WaitForProgress(job);  // of the measurement
  {
    const std::lock_guard lock(versions_.mutex);
    versions_.listed = {{{"town", 2}, false, "jobs/later"}, {versions_.published[job], false, job}};
  }
  Retention retention({.versions = 1}, *supervisor_, versions_);
  ASSERT_TRUE(retention.Sweep(now_).ok());
  EXPECT_THAT(versions_.deleted, IsEmpty());
  ASSERT_TRUE(supervisor_->Cancel(job).ok());
  WaitForEnd(job);
  ASSERT_TRUE(retention.Sweep(now_).ok());
  EXPECT_THAT(versions_.deleted, ElementsAre("models/town/versions/1"));
}

TEST_F(RetentionTest, AnInfiniteAgeKeepsEverything) {
  AddEnded("ancient", v1::JOB_STATE_FAILED, absl::Hours(24 * 10'000));
  Start();
  Retention retention({.jobs = absl::InfiniteDuration(), .checkpoints = absl::InfiniteDuration()},
                      *supervisor_, versions_);
  ASSERT_TRUE(retention.Sweep(now_).ok());
  EXPECT_TRUE(HasJob("ancient") && HasCheckpoints("ancient"));
}

TEST_F(RetentionTest, SweepsAtTheStart) {
  AddEnded("ancient", v1::JOB_STATE_SUCCEEDED, absl::Hours(24 * 91));
  Start();
  Retention retention({}, *supervisor_, versions_);
  const bool gone = WaitForNews(supervisor_->news(), "jobs/ancient", [&] {
    static bool started = false;
    if (!std::exchange(started, true)) retention.SweepRegularly(absl::Hours(1));
    return !HasJob("ancient");
  });
  EXPECT_TRUE(gone);
}

}  // namespace
}  // namespace maneuver::jobs::retention_test
