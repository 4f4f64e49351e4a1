#include "server/jobs/lease_keeper.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace maneuver::jobs::lease_keeper_test {
namespace {

using std::chrono::milliseconds;

// A store whose leases have to be renewed, with an answer that the test gives.
class LeasingStore final : public JobStore {
 public:
  LeasingStore(milliseconds lease_time, std::function<absl::StatusOr<bool>()> renew)
      : lease_time_(lease_time), renew_(std::move(renew)) {}

  std::optional<milliseconds> LeaseTime() const override { return lease_time_; }
  absl::StatusOr<bool> Renew(const JobLease&) override { return renew_(); }

  absl::Status Add(const v1::Job&, const std::string&, const std::string&) override { return No(); }
  absl::StatusOr<v1::Job> Get(const std::string&) override { return No(); }
  absl::StatusOr<std::optional<RequestedJob>> FindRequest(const std::string&) override {
    return No();
  }
  absl::StatusOr<JobPage> List(int, const std::string&) override { return No(); }
  absl::StatusOr<std::vector<v1::Job>> ListInState(v1::JobState, std::optional<int>) override {
    return No();
  }
  absl::StatusOr<int64_t> CountInState(v1::JobState) override { return No(); }
  absl::Status Move(v1::JobState, const v1::Job&) override { return No(); }
  absl::StatusOr<std::optional<ClaimedJob>> Claim(const JobEdit&,
                                                  const std::optional<WorkerCapacity>&) override {
    return No();
  }
  absl::Status Finish(const JobLease&, const JobEdit&) override { return No(); }
  absl::StatusOr<std::vector<v1::Job>> TakeAbandoned(const JobEdit&) override { return No(); }
  absl::StatusOr<v1::Job> RequestCancel(const std::string&) override { return No(); }
  absl::Status AddProgress(const JobLease&, const v1::JobProgress&) override { return No(); }
  absl::StatusOr<std::vector<v1::JobProgress>> ListProgress(const std::string&, int64_t,
                                                            int) override {
    return No();
  }
  absl::StatusOr<std::vector<JobPosition>> ListPositions(const std::vector<std::string>&) override {
    return No();
  }
  absl::Status Delete(const std::string&) override { return No(); }

 private:
  static absl::Status No() { return absl::UnimplementedError("nobody asks"); }

  const milliseconds lease_time_;
  const std::function<absl::StatusOr<bool>()> renew_;
};

void WaitUntil(const std::function<bool()>& done) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (!done() && std::chrono::steady_clock::now() < deadline) {
    std::this_thread::sleep_for(milliseconds(1));
  }
}

// Moves when the test says so.
class FakeClock {
 public:
  LeaseKeeper::Time Now() const { return LeaseKeeper::Time(milliseconds(milliseconds_)); }
  void Advance(milliseconds time) { milliseconds_ += time.count(); }

 private:
  std::atomic<int64_t> milliseconds_ = 0;
};

constexpr milliseconds kLease{80};

TEST(LeaseKeeperTest, KillsAJobWhoseLeaseIsNotRenewedInTimeEvenIfTheStoreHangs) {
  std::atomic<bool> is_over = false;
  std::atomic<bool> hangs = false;
  LeasingStore store(kLease, [&]() -> absl::StatusOr<bool> {
    hangs = true;
    while (!is_over) std::this_thread::sleep_for(milliseconds(1));
    return absl::UnavailableError("too late");
  });
  FakeClock clock;
  LeaseKeeper keeper(
      store, [] {}, [&] { return clock.Now(); });
  const auto run = std::make_shared<StopRequest>();
  keeper.Keep({"jobs/a", 1}, run, clock.Now());
  WaitUntil([&] { return hangs.load(); });
  EXPECT_EQ(run->reason(), StopRequest::Reason::kNone);
  clock.Advance(kLease * 3 / 4);  // somebody else may begin only after all of it
  WaitUntil([&] { return run->reason() != StopRequest::Reason::kNone; });
  EXPECT_EQ(run->reason(), StopRequest::Reason::kLeaseLost);
  is_over = true;
}

TEST(LeaseKeeperTest, KillsAJobWhoseLeaseIsAnotherWorkersNow) {
  LeasingStore store(kLease, [] { return absl::AbortedError("it has ended"); });
  FakeClock clock;
  LeaseKeeper keeper(
      store, [] {}, [&] { return clock.Now(); });
  const auto run = std::make_shared<StopRequest>();
  keeper.Keep({"jobs/a", 1}, run, clock.Now());
  WaitUntil([&] { return run->reason() != StopRequest::Reason::kNone; });
  EXPECT_EQ(run->reason(), StopRequest::Reason::kLeaseLost);
}

TEST(LeaseKeeperTest, SaysOnceThatItKillsACancelledJob) {
  LeasingStore store(kLease, [] { return absl::AbortedError("it has ended"); });
  FakeClock clock;
  std::atomic<int> beats = 0;
  const auto run = std::make_shared<StopRequest>();
  run->Stop(StopRequest::Reason::kCancelled);
  testing::internal::CaptureStderr();
  {
    LeaseKeeper keeper(
        store, [&] { ++beats; }, [&] { return clock.Now(); });
    keeper.Keep({"jobs/a", 1}, run, clock.Now());
    const int before = beats;
    WaitUntil([&] { return beats > before + 5; });
  }
  const std::string log = testing::internal::GetCapturedStderr();
  const std::string line = "job was killed";
  EXPECT_NE(log.find(line), std::string::npos) << log;
  EXPECT_EQ(log.find(line), log.rfind(line)) << log;
}

TEST(LeaseKeeperTest, RenewsLeasesInTimeAndCancelsWhatIsToBeCancelled) {
  FakeClock clock;
  std::atomic<int> renewals = 0;
  LeasingStore store(kLease, [&]() -> absl::StatusOr<bool> {
    clock.Advance(kLease / 4);
    return ++renewals == 20;
  });
  LeaseKeeper keeper(
      store, [] {}, [&] { return clock.Now(); });
  const auto run = std::make_shared<StopRequest>();
  keeper.Keep({"jobs/a", 1}, run, clock.Now());
  WaitUntil([&] { return run->reason() != StopRequest::Reason::kNone; });
  EXPECT_EQ(run->reason(), StopRequest::Reason::kCancelled);
}

TEST(LeaseKeeperTest, LeavesAReleasedJobAlone) {
  FakeClock clock;
  std::atomic<int> beats = 0;
  LeasingStore store(kLease, [] { return absl::AbortedError("it has ended"); });
  const auto run = std::make_shared<StopRequest>();
  const auto other = std::make_shared<StopRequest>();
  LeaseKeeper keeper(
      store, [&] { ++beats; }, [&] { return clock.Now(); });
  keeper.Keep({"jobs/b", 2}, other, clock.Now());
  keeper.Release("jobs/b");
  keeper.Keep({"jobs/a", 1}, run, clock.Now());
  clock.Advance(kLease);
  WaitUntil([&] { return beats > 2 && run->reason() != StopRequest::Reason::kNone; });
  EXPECT_NE(run->reason(), StopRequest::Reason::kNone);
  EXPECT_EQ(other->reason(), StopRequest::Reason::kNone);
}

}  // namespace
}  // namespace maneuver::jobs::lease_keeper_test
