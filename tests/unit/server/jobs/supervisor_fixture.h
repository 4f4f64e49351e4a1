// A supervisor with a real store, a real dataset and, as its trainer, a real process: a shell
// script that speaks the trainer's protocol and does what the test says.

#ifndef MANEUVER_TESTS_UNIT_SERVER_JOBS_SUPERVISOR_FIXTURE_H_
#define MANEUVER_TESTS_UNIT_SERVER_JOBS_SUPERVISOR_FIXTURE_H_

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "maneuver/v1/status.pb.h"
#include "model/data/dataset_folder.h"
#include "server/jobs/job_state.h"
#include "server/jobs/supervisor.h"
#include "server/store/sqlite_store.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/server/jobs/fake_model_versions.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::jobs {

// Calls `done` until it returns true: at once, and after each piece of news of the job.
inline bool WaitForNews(JobNews& news, const std::string& job, const std::function<bool()>& done) {
  std::mutex mutex;
  std::condition_variable changed;
  int count = 0;
  const auto subscription = news.Subscribe(job, [&] {
    const std::lock_guard lock(mutex);
    ++count;
    changed.notify_all();
  });
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  for (;;) {
    int seen;
    {
      const std::lock_guard lock(mutex);
      seen = count;
    }
    if (done()) return true;
    std::unique_lock lock(mutex);
    if (!changed.wait_until(lock, deadline, [&] { return count != seen; })) return false;
  }
}

// Returns the job as of each of its events, until it has ended.
//   after_sequence, limit: as in JobEventReader
inline std::vector<v1::Job> Follow(JobNews& news, JobStore& store, const std::string& job,
                                   int64_t after_sequence, int limit) {
  std::vector<v1::Job> all;
  JobEventReader reader(store, news, job, after_sequence);
  EXPECT_TRUE(WaitForNews(news, job, [&] {
    for (;;) {
      const auto events = reader.Next(limit);
      EXPECT_TRUE(events.ok()) << events.status();
      if (!events.ok()) return true;
      all.insert(all.end(), events->begin(), events->end());
      if (events->empty() || reader.at_end()) return reader.at_end();
    }
  }));
  return all;
}

class SupervisorTest : public testing::Test {
 protected:
  SupervisorTest() {
    datasets_ = *data::DatasetStore::Open(folder_ / "datasets");
    OpenStore();
    for (const char* name : {"town", "village"}) {
      auto writer = data::DatasetWriter::Create(datasets_->FolderOf(name), "a test");
      EXPECT_TRUE((*writer)->Add(data::SmallRecording("r0")).ok());
      EXPECT_TRUE((*writer)->Commit().ok());
    }
    Trainer("mkdir \"$output\"; echo weights > \"$output/weights\"");
  }

  void OpenStore() {
    store_.reset();
    store_ = *store::SqliteStore::Open(folder_ / "maneuver.db");
  }

  // Leaves a job as a server that was killed does: RUNNING, with `begin` applied and a last event.
  void LeaveRunning(const v1::Job& pending, const JobEdit& begin,
                    const std::optional<v1::JobProgress>& progress = std::nullopt) {
    ASSERT_TRUE(store_->Add(pending, "", "").ok());
    const auto claimed = store_->Claim(begin);
    ASSERT_TRUE(claimed.ok() && *claimed) << claimed.status();
    if (progress) {
      ASSERT_TRUE(store_->AddProgress((*claimed)->lease, *progress).ok());
    }
    OpenStore();
  }

  // Makes the trainer do what `body` says, in the language of sh. $command, $output, $settings,
  // $dataset, $dataset_name, $model, $checkpoints are its arguments, $arguments all of them.
  void Trainer(const std::string& body) {
    const std::filesystem::path file = folder_ / "trainer";
    // Replaced, not rewritten: a process may still run the one before.
    std::ofstream(folder_ / "trainer.new") << R"(#!/bin/sh
arguments="$*"; command=$1; shift
while [ $# -gt 0 ]; do
  case $1 in
    --output) output=$2;; --settings) settings=$2;; --dataset) dataset=$2;;
    --dataset-name) dataset_name=$2;; --model) model=$2;; --checkpoints) checkpoints=$2;;
  esac
  shift 2
done
)" << body << "\n";
    std::filesystem::permissions(folder_ / "trainer.new", std::filesystem::perms::owner_all);
    std::filesystem::rename(folder_ / "trainer.new", file);
  }

  SupervisorOptions Options() {
    SupervisorOptions options;
    options.folder = folder_ / "jobs";
    options.tags = folder_ / "tags";
    options.trainer = folder_ / "trainer";
    return options;
  }

  void Start() { StartWith(Options()); }
  void StartWith(SupervisorOptions options) {
    auto supervisor =
        Supervisor::Start(std::move(options), *store_, *datasets_, versions_, *job_metrics_);
    ASSERT_TRUE(supervisor.ok()) << supervisor.status();
    supervisor_ = *std::move(supervisor);
  }

  // Counts in these metrics from the next start on. They must live until the supervisor has
  // stopped.
  void UseMetrics(monitoring::MetricRegistry& metrics) { job_metrics_ = &metrics; }

  static v1::TrainRequest TrainTown() {
    v1::TrainRequest request;
    request.set_model("models/town");
    request.add_datasets("datasets/town");
    return request;
  }

  v1::Job Train(const v1::TrainRequest& request = TrainTown()) {
    const auto job = supervisor_->Train(request);
    EXPECT_TRUE(job.ok()) << job.status();
    return job.ok() ? *job : v1::Job();
  }

  v1::Job WaitForEnd(const std::string& job) {
    return WaitFor(job, [](const v1::Job& j) { return HasEnded(j.state()); });
  }
  // Waits until the trainer has reported something: it runs, and has set its traps.
  v1::Job WaitForProgress(const std::string& job) {
    return WaitFor(job, [](const v1::Job& j) { return j.has_progress(); });
  }
  v1::Job WaitFor(const std::string& name, const std::function<bool(const v1::Job&)>& done) {
    v1::Job job;
    EXPECT_TRUE(WaitForNews(supervisor_->news(), name, [&] {
      job = *store_->Get(name);
      return done(job);
    })) << job.DebugString();
    return job;
  }

  static std::string ReasonOf(const v1::Job& job) {
    v1::ErrorInfo info;
    if (job.error().details().empty()) return "";
    info.ParseFromString(job.error().details(0).value());
    return info.reason();
  }

  std::filesystem::path FolderOf(const v1::Job& job) const {
    return folder_ / job.name();  // jobs/{id}
  }

  const TemporaryFolder folder_;
  std::unique_ptr<data::DatasetStore> datasets_;
  std::unique_ptr<store::SqliteStore> store_;
  monitoring::MetricRegistry* job_metrics_ = &monitoring::MetricRegistry::Null();
  FakeModelVersions versions_{folder_.path()};
  std::unique_ptr<Supervisor> supervisor_;
};

// The trainer reports once and goes on until it is told to stop.
inline constexpr char kRunsOn[] =
    "trap 'exit 143' TERM; echo '{\"phase\":\"load\"}'; while :; do sleep 0.02; done";
inline constexpr char kIgnoresSigterm[] =
    "trap '' TERM; echo '{\"phase\":\"load\"}'; while :; do sleep 0.02; done";

}  // namespace maneuver::jobs

#endif  // MANEUVER_TESTS_UNIT_SERVER_JOBS_SUPERVISOR_FIXTURE_H_
