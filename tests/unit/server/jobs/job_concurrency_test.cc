// Two hundred clients at the same time create, cancel, resume, delete and watch jobs whose
// processes succeed, fail and die; all that the store was told is held against a reference model.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <condition_variable>
#include <fstream>
#include <mutex>
#include <random>
#include <set>
#include <thread>

#include "server/jobs/job_folder.h"
#include "tests/unit/server/jobs/supervisor_fixture.h"

namespace maneuver::jobs::job_concurrency_test {
namespace {

constexpr int kClients = 200;
constexpr int kMaxRunning = 3;

// One change that the store accepted.
struct Change {
  enum class Kind { kAdd, kMove, kUpdate, kDelete } kind;
  v1::JobState from;
  v1::Job job;  // as it is afterwards; of kDelete, the name alone
};

// Passes on everything, and writes down what was accepted in the order in which it was.
class RecordingStore : public JobStore {
 public:
  explicit RecordingStore(JobStore& store) : store_(store) {}

  absl::Status Add(const v1::Job& job, const std::string& request_id,
                   const std::string& request_digest) override {
    const std::lock_guard lock(mutex_);
    return Keep({Change::Kind::kAdd, job.state(), job},
                store_.Add(job, request_id, request_digest));
  }
  absl::Status Move(v1::JobState from, const v1::Job& job) override {
    const std::lock_guard lock(mutex_);
    return Keep({Change::Kind::kMove, from, job}, store_.Move(from, job));
  }
  absl::StatusOr<std::optional<ClaimedJob>> Claim(
      const JobEdit& begin, const std::optional<WorkerCapacity>& worker) override {
    const std::lock_guard lock(mutex_);
    auto claimed = store_.Claim(begin, worker);
    if (claimed.ok() && *claimed) {
      changes_.push_back({Change::Kind::kMove, v1::JOB_STATE_PENDING, (*claimed)->job});
    }
    return claimed;
  }
  absl::Status Finish(const JobLease& lease, const JobEdit& end) override {
    const std::lock_guard lock(mutex_);
    v1::Job ended;
    const absl::Status status = store_.Finish(lease, [&](v1::Job& job) {
      end(job);
      ended = job;
    });
    return Keep({Change::Kind::kMove, v1::JOB_STATE_RUNNING, ended}, status);
  }
  absl::StatusOr<std::vector<v1::Job>> TakeAbandoned(const JobEdit& end) override {
    return store_.TakeAbandoned(end);  // none here: the store is new
  }
  absl::StatusOr<v1::Job> RequestCancel(const std::string& name) override {
    const std::lock_guard lock(mutex_);
    auto job = store_.RequestCancel(name);
    if (job.ok()) changes_.push_back({Change::Kind::kUpdate, job->state(), *job});
    return job;
  }
  absl::Status Delete(const std::string& name) override {
    const std::lock_guard lock(mutex_);
    v1::Job job;
    job.set_name(name);
    return Keep({Change::Kind::kDelete, v1::JOB_STATE_UNSPECIFIED, job}, store_.Delete(name));
  }
  std::optional<std::chrono::milliseconds> LeaseTime() const override { return store_.LeaseTime(); }
  absl::StatusOr<bool> Renew(const JobLease& lease) override { return store_.Renew(lease); }
  absl::StatusOr<v1::Job> Get(const std::string& name) override { return store_.Get(name); }
  absl::StatusOr<std::optional<RequestedJob>> FindRequest(const std::string& id) override {
    return store_.FindRequest(id);
  }
  absl::StatusOr<JobPage> List(int size, const std::string& token) override {
    return store_.List(size, token);
  }
  absl::StatusOr<std::vector<v1::Job>> ListInState(v1::JobState state,
                                                   std::optional<int> limit) override {
    return store_.ListInState(state, limit);
  }
  absl::StatusOr<int64_t> CountInState(v1::JobState state) override {
    return store_.CountInState(state);
  }
  absl::Status AddProgress(const JobLease& lease, const v1::JobProgress& progress) override {
    return store_.AddProgress(lease, progress);
  }
  absl::StatusOr<std::vector<v1::JobProgress>> ListProgress(const std::string& name, int64_t after,
                                                            int limit) override {
    return store_.ListProgress(name, after, limit);
  }

  absl::StatusOr<std::vector<JobPosition>> ListPositions(
      const std::vector<std::string>& names) override {
    return store_.ListPositions(names);
  }

  const std::vector<Change>& changes() const { return changes_; }  // once nobody writes

 private:
  absl::Status Keep(Change change, absl::Status status) {
    if (status.ok()) changes_.push_back(std::move(change));
    return status;
  }

  JobStore& store_;
  std::mutex mutex_;
  std::vector<Change> changes_;  // guarded by mutex_
};

// A store that servers share. Whenever this one adds a job, another server begins it at once, and
// the answer to this one is lost.
class LosingStore final : public RecordingStore {
 public:
  LosingStore(JobStore& store, std::filesystem::path folder)
      : RecordingStore(store), folder_(std::move(folder)) {}

  std::optional<std::chrono::milliseconds> LeaseTime() const override {
    return std::chrono::seconds(15);
  }
  absl::Status Add(const v1::Job& job, const std::string& request_id,
                   const std::string& request_digest) override {
    absl::Status status = RecordingStore::Add(job, request_id, request_digest);
    if (!status.ok()) return status;
    EXPECT_TRUE(MakeAttemptFolder(folder_ / job.name(), 1).ok());
    return errors::WithReason(absl::UnavailableError("the answer is lost"), "STORE_UNAVAILABLE");
  }

 private:
  const std::filesystem::path folder_;
};

// The queue as docs/guides/jobs.md describes it, written down once more.
class ReferenceModel {
 public:
  void Apply(const Change& change) {
    const std::string& name = change.job.name();
    const auto found = jobs_.find(name);
    if (change.kind == Change::Kind::kAdd) {
      EXPECT_EQ(found, jobs_.end()) << name << " is added twice";
      EXPECT_EQ(change.job.state(), v1::JOB_STATE_PENDING);
      jobs_[name] = {v1::JOB_STATE_PENDING, change.job.train().priority(), next_age_++};
      return;
    }
    ASSERT_NE(found, jobs_.end()) << name << " is not there";
    Entry& job = found->second;
    switch (change.kind) {
      case Change::Kind::kMove:
        EXPECT_EQ(job.state, change.from) << name;
        Move(name, job, change.job.state());
        break;
      case Change::Kind::kUpdate:  // a cancellation is asked for
        EXPECT_EQ(job.state, v1::JOB_STATE_RUNNING);
        EXPECT_TRUE(change.job.cancel_requested());
        job.to_be_cancelled = true;
        break;
      default:
        EXPECT_TRUE(Ended(job.state)) << name << " is deleted in state " << job.state;
        jobs_.erase(found);
    }
  }

  std::map<std::string, v1::JobState> States() const {
    std::map<std::string, v1::JobState> states;
    for (const auto& [name, job] : jobs_) states[name] = job.state;
    return states;
  }
  // Jobs that have SUCCEEDED, deleted ones too.
  const std::set<std::string>& succeeded() const { return succeeded_; }
  int resumed() const { return resumed_; }
  int interrupted() const { return interrupted_; }

 private:
  struct Entry {
    v1::JobState state;
    int priority;
    int age;
    bool to_be_cancelled = false;
  };

  static bool Ended(v1::JobState state) {
    return state == v1::JOB_STATE_SUCCEEDED || state == v1::JOB_STATE_FAILED ||
           state == v1::JOB_STATE_CANCELLED;
  }

  void Move(const std::string& name, Entry& job, v1::JobState to) {
    switch (job.state) {
      case v1::JOB_STATE_PENDING:
        EXPECT_TRUE(to == v1::JOB_STATE_RUNNING || to == v1::JOB_STATE_CANCELLED) << to;
        if (to == v1::JOB_STATE_RUNNING) {
          EXPECT_LT(running_, kMaxRunning);
          ++running_;
          for (const auto& [other_name, other] : jobs_) {
            if (other.state != v1::JOB_STATE_PENDING) continue;
            EXPECT_FALSE(std::pair(-other.priority, other.age) < std::pair(-job.priority, job.age))
                << other_name << " goes before " << name;
          }
        }
        break;
      case v1::JOB_STATE_RUNNING:
        EXPECT_TRUE(Ended(to) || (to == v1::JOB_STATE_PENDING && !job.to_be_cancelled)) << to;
        EXPECT_TRUE(to != v1::JOB_STATE_CANCELLED || job.to_be_cancelled) << name;
        if (to == v1::JOB_STATE_PENDING) ++interrupted_;
        EXPECT_TRUE(to != v1::JOB_STATE_SUCCEEDED || succeeded_.insert(name).second) << name;
        --running_;
        job.to_be_cancelled = false;
        break;
      default:
        EXPECT_NE(job.state, v1::JOB_STATE_SUCCEEDED);
        EXPECT_EQ(to, v1::JOB_STATE_PENDING);
        ++resumed_;
    }
    job.state = to;
  }

  std::map<std::string, Entry> jobs_;
  std::set<std::string> succeeded_;
  int next_age_ = 0;
  int running_ = 0;
  int resumed_ = 0;
  int interrupted_ = 0;
};

class JobConcurrencyTest : public SupervisorTest {
 protected:
  // By the seed of its settings the trainer succeeds, fails, or dies once after a checkpoint.
  JobConcurrencyTest() {
    Trainer(R"sh(seed=$(sed -n 's/.*"seed": "\([0-9]*\)".*/\1/p' "$settings")
                 mkdir -p "$checkpoints"
                 echo '{"phase":"joint","epochReport":{}}'
                 case $((seed % 4)) in
                   0) exit 80;;
                   1) [ -e "$checkpoints/checkpoint-000001" ] ||
                        { : > "$checkpoints/checkpoint-000001"; kill -9 $$; };;
                 esac
                 mkdir "$output")sh");
  }

  v1::TrainRequest Request(int client) {
    v1::TrainRequest request = TrainTown();
    request.set_request_id("pair-" + std::to_string(client / 2));
    request.set_priority(client / 2 % 3);
    request.mutable_settings()->set_seed(client / 2 + 1);
    return request;
  }

  // Everything that a client may do, in an order of its own; what it is told must be possible.
  void Act(int client) {
    std::mt19937 random(static_cast<unsigned>(client));
    const auto job = supervisor_->Train(Request(client));
    ASSERT_TRUE(job.ok()) << job.status();
    for (int i = 0; i < 4; ++i) {
      switch (random() % 5) {
        case 0:
          Watch(job->name());
          break;
        case 1: {
          const auto cancelled = supervisor_->Cancel(job->name());
          if (cancelled.ok()) {
            EXPECT_NE(cancelled->state(), v1::JOB_STATE_PENDING);
            EXPECT_TRUE(cancelled->state() != v1::JOB_STATE_RUNNING ||
                        cancelled->cancel_requested());
          } else {
            EXPECT_TRUE(absl::IsNotFound(cancelled.status())) << cancelled.status();
          }
          break;
        }
        case 2: {
          const auto resumed = supervisor_->Resume(job->name());
          if (resumed.ok()) {
            EXPECT_TRUE(resumed->state() == v1::JOB_STATE_PENDING ||
                        resumed->state() == v1::JOB_STATE_RUNNING);
          } else {
            EXPECT_TRUE(absl::IsNotFound(resumed.status()) ||
                        absl::IsFailedPrecondition(resumed.status()))
                << resumed.status();
          }
          break;
        }
        case 3: {
          const absl::Status deleted = supervisor_->Delete(job->name());
          if (!deleted.ok()) {
            EXPECT_TRUE(absl::IsNotFound(deleted) || absl::IsFailedPrecondition(deleted))
                << deleted;
          }
          break;
        }
        default:
          EXPECT_TRUE(supervisor_->List(10, "").ok());
      }
    }
  }

  // To the end of the job or its deletion: numbers without a gap, then one that has ended.
  void Watch(const std::string& name) {
    JobEventReader reader(supervisor_->store(), supervisor_->news(), name, 0);
    int64_t last = 0;
    EXPECT_TRUE(WaitForNews(supervisor_->news(), name, [&] {
      for (;;) {
        const auto events = reader.Next(3);
        if (!events.ok()) {
          EXPECT_TRUE(absl::IsNotFound(events.status())) << events.status();
          return true;
        }
        for (const v1::Job& event : *events) {
          if (HasEnded(event.state())) {
            EXPECT_EQ(&event, &events->back());
            EXPECT_GE(event.progress().sequence(), last);
          } else {
            EXPECT_EQ(event.progress().sequence(), last + 1);
            last = event.progress().sequence();
          }
        }
        if (events->empty() || reader.at_end()) return reader.at_end();
      }
    }));
  }
};

TEST_F(JobConcurrencyTest, AJobWhoseAdmissionWasLostKeepsItsFolderForTheServerThatRunsIt) {
  LosingStore store(*store_, folder_.path());
  SupervisorOptions options = Options();
  options.max_running_jobs = 0;  // the other server runs it
  options.new_id = [] { return "lost"; };
  const auto supervisor = Supervisor::Start(std::move(options), store, *datasets_, versions_);
  ASSERT_TRUE(supervisor.ok()) << supervisor.status();
  const absl::Status status = (*supervisor)->Train(TrainTown()).status();
  EXPECT_TRUE(errors::IsStoreAway(status)) << status;
  EXPECT_TRUE(std::filesystem::exists(folder_ / "jobs/lost/attempts/1/settings.json"));
}

TEST_F(JobConcurrencyTest, TwoHundredConcurrentClientsCauseOnlyAllowedMoves) {
  RecordingStore store(*store_);
  SupervisorOptions options = Options();
  options.max_running_jobs = kMaxRunning;
  auto supervisor = Supervisor::Start(std::move(options), store, *datasets_, versions_);
  ASSERT_TRUE(supervisor.ok()) << supervisor.status();
  supervisor_ = *std::move(supervisor);
  std::vector<std::thread> clients;
  for (int client = 0; client < kClients; ++client) {
    clients.emplace_back([this, client] { Act(client); });
  }
  for (std::thread& client : clients) client.join();
  const auto left = store_->List(1'000, "");
  ASSERT_TRUE(left.ok());
  for (const v1::Job& job : left->jobs) WaitForEnd(job.name());
  supervisor_->Stop();

  ReferenceModel model;
  for (const Change& change : store.changes()) model.Apply(change);
  std::map<std::string, v1::JobState> stored;
  const auto page = store_->List(1'000, "");
  ASSERT_TRUE(page.ok());
  for (const v1::Job& job : page->jobs) stored[job.name()] = job.state();
  EXPECT_EQ(stored, model.States());
  // A version for each that has SUCCEEDED, and for no other.
  std::set<std::string> published;
  for (const auto& [maker, version] : versions_.published) published.insert(maker);
  EXPECT_EQ(published, model.succeeded());
  EXPECT_EQ(versions_.promotions.size(), published.size());
  // Folders for those that are left, and for no other.
  for (const auto& entry : std::filesystem::directory_iterator(folder_ / "jobs")) {
    EXPECT_TRUE(stored.contains("jobs/" + entry.path().filename().string())) << entry;
  }
  // Nothing of this was idle.
  EXPECT_GT(model.resumed(), 0);
  EXPECT_GT(model.interrupted(), 0);
  EXPECT_GT(model.succeeded().size(), 10u);
  EXPECT_LT(stored.size(), 100u);
}

// A store that servers share.
class SharedStore final : public RecordingStore {
 public:
  using RecordingStore::RecordingStore;

  std::optional<std::chrono::milliseconds> LeaseTime() const override {
    return std::chrono::milliseconds(80);
  }
  absl::StatusOr<std::optional<ClaimedJob>> Claim(
      const JobEdit& begin, const std::optional<WorkerCapacity>& worker) override {
    {
      const std::lock_guard lock(devices_mutex_);
      devices_ = worker ? worker->devices : std::set<std::string>();
    }
    changed_.notify_all();
    return RecordingStore::Claim(begin, worker);
  }

  // Waits until a job is asked for that may need the device. False after a minute.
  bool WaitForDevice(const std::string& device) {
    std::unique_lock lock(devices_mutex_);
    return changed_.wait_for(lock, std::chrono::seconds(60),
                             [&] { return devices_.contains(device); });
  }

 private:
  std::mutex devices_mutex_;
  std::condition_variable changed_;
  std::set<std::string> devices_;  // of the latest Claim
};

TEST_F(JobConcurrencyTest, TakesJobsForADeviceWhoseDriverCameAfterTheServer) {
  Trainer("[ $command = devices ] && echo cpu && echo cuda");
  SharedStore store(*store_);
  SupervisorOptions options = Options();
  options.graphics = {folder_ / "driver"};
  const auto supervisor = Supervisor::Start(std::move(options), store, *datasets_, versions_);
  ASSERT_TRUE(supervisor.ok()) << supervisor.status();
  EXPECT_TRUE(store.WaitForDevice("cpu"));
  std::ofstream(folder_ / "driver") << "";
  EXPECT_TRUE(store.WaitForDevice("cuda"));
  const auto told = (*supervisor)->Capacity();  // to the other servers
  EXPECT_TRUE(told && told->devices.contains("cuda"));
}

}  // namespace
}  // namespace maneuver::jobs::job_concurrency_test
