#include "server/store/sqlite_store.h"

#include <sqlite3.h>

#include <iterator>
#include <map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "locks/mutex.h"
#include "server/jobs/job_state.h"
#include "server/store/sqlite_schema.h"
#include "server/store/sqlite_statement.h"
#include "server/store/stored_job.h"

namespace maneuver::store {
namespace {

// Long enough for a predecessor that is shutting down.
constexpr int kBusyTimeoutMs = 1'000;

// Columns that JobFrom reads: the job, and its latest event or NULL.
#define JOB_COLUMNS                                                                          \
  "number, job, (SELECT progress FROM progress WHERE job_number = number ORDER BY sequence " \
  "DESC LIMIT 1), name, state"

absl::StatusOr<v1::Job> JobFrom(const Statement& row) {
  return ParseStoredJob({row.Bytes(3), row.Int(4)}, row.Bytes(1),
                        row.IsNull(2) ? std::nullopt : std::optional(row.Bytes(2)));
}

void AddToPage(const Statement& row, DamageLog& damage, jobs::JobPage* page) {
  store::AddToPage(JobFrom(row), row.Bytes(3), damage, page);
}

// Columns that AliasFrom reads.
#define ALIAS_COLUMNS "model, alias, version, digest"

absl::StatusOr<serving::ModelAlias> AliasFrom(const Statement& row) {
  return StoredAlias({row.Bytes(0), row.Bytes(1)}, row.Int(2),
                     row.IsNull(3) ? std::nullopt : std::optional(row.Int(3)));
}

class FileStore final : public SqliteStore {
 public:
  explicit FileStore(sqlite3* database) : database_(database) {}
  ~FileStore() override { sqlite3_close_v2(database_); }

  absl::Status Prepare() {
    const MutexLock lock(mutex_);
    sqlite3_extended_result_codes(database_, 1);
    // A store that does not open is closed as it is. SQLite would otherwise bring its journal into
    // the file and delete it, which has cost the newest changes when the disk failed just then.
    CheckpointOnClose(false);
    sqlite3_busy_timeout(database_, kBusyTimeoutMs);
    // Not locked against readers: a back-up copies it while the server runs. A second server is
    // kept off by the lock of the data folder.
    // Each change goes into the file right after it is in the journal. Otherwise damage to one of the
    // journal's changes would silently undo it and those after it when the server starts again.
    for (const char* pragma : {"PRAGMA journal_mode = WAL", "PRAGMA wal_autocheckpoint = 1",
                               "PRAGMA synchronous = FULL", "PRAGMA foreign_keys = ON"}) {
      if (absl::Status status = Execute(database_, pragma); !status.ok()) return status;
    }
    if (absl::Status status = CheckIntegrity(); !status.ok()) return status;
    if (absl::Status status = PrepareSchema(database_); !status.ok()) return status;
    if (absl::Status status = CheckEvents(); !status.ok()) return status;
    CheckpointOnClose(true);
    return absl::OkStatus();
  }

  absl::Status Add(const v1::Job& job, const std::string& request_id,
                   const std::string& request_digest) override {
    const MutexLock lock(mutex_);
    const std::string blob = StoredJob(job);
    Statement insert(database_,
                     "INSERT INTO jobs (name, state, priority, create_time, request_digest, job, "
                     "request_id) VALUES (?, ?, ?, ?, ?, ?, ?)");
    insert.Bind(job.name()).Bind(job.state()).Bind(PriorityOf(job));
    insert.Bind(CreateMicros(job)).Bind(request_digest);
    insert.BindBlob(blob);
    request_id.empty() ? insert.BindNull() : insert.Bind(request_id);
    return insert.Run();
  }

  absl::StatusOr<v1::Job> Get(const std::string& name) override {
    const MutexLock lock(mutex_);
    return GetLocked(name);
  }

  absl::StatusOr<std::optional<jobs::RequestedJob>> FindRequest(
      const std::string& request_id) override {
    const MutexLock lock(mutex_);
    Statement select(database_,
                     "SELECT " JOB_COLUMNS ", request_digest FROM jobs WHERE request_id = ?");
    const auto row = select.Bind(request_id).Step();
    if (!row.ok()) return row.status();
    if (!*row) return std::optional<jobs::RequestedJob>();
    auto job = JobFrom(select);
    if (!job.ok()) return job.status();
    return std::optional<jobs::RequestedJob>({*std::move(job), select.Bytes(5)});
  }

  absl::StatusOr<jobs::JobPage> List(int page_size, const std::string& page_token) override {
    const auto before = ParsePageToken(page_token);
    if (!before.ok()) return before.status();
    const MutexLock lock(mutex_);
    Statement select(database_, "SELECT " JOB_COLUMNS
                                " FROM jobs WHERE number < ? ORDER BY number DESC LIMIT ?");
    select.Bind(*before).Bind(int64_t{page_size} + 1);
    jobs::JobPage page;
    int64_t last = 0;
    for (int count = 0;; ++count) {
      const auto row = select.Step();
      if (!row.ok()) return row.status();
      if (!*row) return page;
      if (count == page_size) {
        page.next_page_token = absl::StrCat(last);
        return page;
      }
      last = select.Int(0);
      AddToPage(select, damage_, &page);
    }
  }

  absl::StatusOr<std::vector<v1::Job>> ListInState(v1::JobState state,
                                                   std::optional<int> limit) override {
    const MutexLock lock(mutex_);
    auto read = ReadInStateLocked(state, limit);
    if (!read.ok()) return read.status();
    if (!read->damaged.empty()) return read->damaged.front().error;
    return std::move(read->jobs);
  }

  absl::StatusOr<int64_t> CountInState(v1::JobState state) override {
    const MutexLock lock(mutex_);
    Statement count(database_, "SELECT COUNT(*) FROM jobs WHERE state = ?");
    const auto row = count.Bind(state).Step();
    if (!row.ok()) return row.status();
    return count.Int(0);
  }

  absl::Status Move(v1::JobState from, const v1::Job& job) override {
    if (absl::Status status = CheckMove(from, job.state()); !status.ok()) return status;
    const MutexLock lock(mutex_);
    return ReplaceLocked(from, job);
  }

  // The server that has this store is the only one: it takes any job.
  absl::StatusOr<std::optional<jobs::ClaimedJob>> Claim(
      const jobs::JobEdit& begin, const std::optional<jobs::WorkerCapacity>&) override {
    const MutexLock lock(mutex_);
    auto pending = SoundInStateLocked(v1::JOB_STATE_PENDING, 1);
    if (!pending.ok()) return pending.status();
    if (pending->empty()) return std::optional<jobs::ClaimedJob>();
    v1::Job& job = pending->front();
    job.set_state(v1::JOB_STATE_RUNNING);
    begin(job);
    absl::Status status = ReplaceLocked(v1::JOB_STATE_PENDING, job);
    if (!status.ok()) return status;
    fences_[job.name()] = ++last_fence_;
    const jobs::JobLease lease = {job.name(), last_fence_};
    return std::optional(jobs::ClaimedJob{std::move(job), lease});
  }

  std::optional<std::chrono::milliseconds> LeaseTime() const override { return std::nullopt; }

  absl::StatusOr<bool> Renew(const jobs::JobLease& lease) override {
    const MutexLock lock(mutex_);
    if (!HoldsLocked(lease)) return LeaseEnded(lease);
    const auto job = GetLocked(lease.job);
    if (!job.ok()) return job.status();
    return job->cancel_requested();
  }

  absl::Status Finish(const jobs::JobLease& lease, const jobs::JobEdit& end) override {
    const MutexLock lock(mutex_);
    if (!HoldsLocked(lease)) return LeaseEnded(lease);
    auto job = GetLocked(lease.job);
    if (!job.ok()) return job.status();
    if (absl::Status status = EditRunning(end, *job); !status.ok()) return status;
    absl::Status status = ReplaceLocked(v1::JOB_STATE_RUNNING, *job);
    if (status.ok()) fences_.erase(lease.job);
    return status;
  }

  absl::StatusOr<std::vector<v1::Job>> TakeAbandoned(const jobs::JobEdit& end) override {
    const MutexLock lock(mutex_);
    auto running = SoundInStateLocked(v1::JOB_STATE_RUNNING, std::nullopt);
    if (!running.ok()) return running.status();
    std::vector<v1::Job> taken;
    for (v1::Job& job : *running) {
      if (fences_.contains(job.name())) continue;
      if (absl::Status status = EditRunning(end, job); !status.ok()) return status;
      absl::Status status = ReplaceLocked(v1::JOB_STATE_RUNNING, job);
      if (!status.ok()) return status;
      taken.push_back(std::move(job));
    }
    return taken;
  }

  absl::StatusOr<v1::Job> RequestCancel(const std::string& name) override {
    const MutexLock lock(mutex_);
    auto job = GetLocked(name);
    if (!job.ok()) return job.status();
    if (job->state() != v1::JOB_STATE_RUNNING) return IsInState(*job);
    job->set_cancel_requested(true);
    absl::Status status = ReplaceLocked(v1::JOB_STATE_RUNNING, *job);
    if (!status.ok()) return status;
    return job;
  }

  absl::Status AddProgress(const jobs::JobLease& lease, const v1::JobProgress& progress) override {
    const MutexLock lock(mutex_);
    if (!HoldsLocked(lease)) return LeaseEnded(lease);
    const std::string blob = StoredProgress(progress);
    Statement insert(database_,
                     "INSERT INTO progress (sequence, progress, job_number) "
                     "SELECT ?, ?, number FROM jobs WHERE name = ?");
    insert.Bind(progress.sequence()).BindBlob(blob).Bind(lease.job);
    return insert.Run();
  }

  absl::StatusOr<std::vector<v1::JobProgress>> ListProgress(const std::string& name,
                                                            int64_t after_sequence,
                                                            int limit) override {
    const MutexLock lock(mutex_);
    Statement select(database_,
                     "SELECT sequence, progress FROM progress "
                     "WHERE job_number = (SELECT number FROM jobs WHERE name = ?) AND sequence > ? "
                     "ORDER BY sequence LIMIT ?");
    select.Bind(name).Bind(after_sequence).Bind(limit);
    std::vector<v1::JobProgress> events;
    for (;;) {
      const auto row = select.Step();
      if (!row.ok()) return row.status();
      if (!*row) return events;
      auto event = ParseStoredProgress(select.Int(0), select.Bytes(1));
      if (!event.ok()) return event.status();
      events.push_back(*std::move(event));
    }
  }

  absl::StatusOr<std::vector<jobs::JobPosition>> ListPositions(
      const std::vector<std::string>& names) override {
    const MutexLock lock(mutex_);
    std::vector<jobs::JobPosition> positions;
    for (const std::string& name : names) {
      Statement select(database_,
                       "SELECT state, COALESCE((SELECT MAX(sequence) FROM progress "
                       "WHERE job_number = number), 0) FROM jobs WHERE name = ?");
      const auto row = select.Bind(name).Step();
      if (!row.ok()) return row.status();
      if (!*row) continue;
      positions.push_back({name, static_cast<v1::JobState>(select.Int(0)), select.Int(1)});
    }
    return positions;
  }

  absl::Status Delete(const std::string& name) override {
    const MutexLock lock(mutex_);
    const auto job = GetLocked(name);
    if (!job.ok()) return job.status();
    if (!jobs::HasEnded(job->state())) return NotEnded(*job);
    return Statement(database_, "DELETE FROM jobs WHERE name = ?").Bind(name).Run();
  }

  absl::StatusOr<bool> SetAliasIf(const security::ModelAliasName& name, int version,
                                  const serving::AliasCondition& condition) override {
    const MutexLock lock(mutex_);
    const jobs::JobLease lease = {condition.maker.name, condition.maker.fence};
    if (lease.fence != 0 && !HoldsLocked(lease)) return LeaseEnded(lease);
    if (condition.before) {
      const auto before = GetAliasLocked(name);
      if (!before.ok() && !absl::IsNotFound(before.status())) return before.status();
      if (before.value_or(0) != *condition.before) return false;
    }
    Statement replace(database_,
                      "INSERT OR REPLACE INTO aliases (model, alias, version, digest) "
                      "VALUES (?, ?, ?, ?)");
    replace.Bind(name.model).Bind(name.alias).Bind(version).Bind(AliasDigest(name, version));
    if (absl::Status status = replace.Run(); !status.ok()) return status;
    return true;
  }

  absl::StatusOr<int> GetAlias(const security::ModelAliasName& name) override {
    const MutexLock lock(mutex_);
    return GetAliasLocked(name);
  }

  absl::StatusOr<std::vector<serving::ModelAlias>> ListAliases() override {
    const MutexLock lock(mutex_);
    Statement select(database_, "SELECT " ALIAS_COLUMNS " FROM aliases ORDER BY model, alias");
    std::vector<serving::ModelAlias> aliases;
    for (;;) {
      const auto row = select.Step();
      if (!row.ok()) return row.status();
      if (!*row) return aliases;
      auto alias = AliasFrom(select);
      if (!alias.ok()) return alias.status();
      aliases.push_back(*std::move(alias));
    }
  }

  absl::Status DeleteAlias(const security::ModelAliasName& name) override {
    const MutexLock lock(mutex_);
    Statement remove(database_, "DELETE FROM aliases WHERE model = ? AND alias = ?");
    if (absl::Status status = remove.Bind(name.model).Bind(name.alias).Run(); !status.ok()) {
      return status;
    }
    return sqlite3_changes(database_) == 1 ? absl::OkStatus() : NoSuchAlias(name);
  }

 private:
  void CheckpointOnClose(bool does) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    sqlite3_db_config(database_, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, does ? 0 : 1, nullptr);
  }

  // Reads the whole file, and compares the indexes with the tables. Some milliseconds for each
  // megabyte.
  absl::Status CheckIntegrity() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    Statement check(database_, "PRAGMA integrity_check(1)");
    const auto row = check.Step();
    if (!row.ok()) return row.status();
    const std::string found = check.Bytes(0);
    if (found == "ok") return absl::OkStatus();
    return absl::DataLossError(absl::StrCat("the job store: ", found));
  }

  // Finds events that no job has, or that come before a job's first: nobody would miss them.
  absl::Status CheckEvents() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    Statement find(database_,
                   "SELECT job_number, sequence FROM progress "
                   "WHERE sequence < 1 OR job_number NOT IN (SELECT number FROM jobs) LIMIT 1");
    const auto row = find.Step();
    if (!row.ok()) return row.status();
    if (!*row) return absl::OkStatus();
    return absl::DataLossError(absl::StrCat("the job store holds event ", find.Int(1),
                                            " of job number ", find.Int(0), ", which cannot be"));
  }

  bool HoldsLocked(const jobs::JobLease& lease) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const auto found = fences_.find(lease.job);
    return found != fences_.end() && found->second == lease.fence;
  }

  // Returns the sound jobs in a state, at most `limit`, in the order in which pending jobs start, and
  // the damaged ones before the last of them.
  absl::StatusOr<jobs::JobPage> ReadInStateLocked(v1::JobState state, std::optional<int> limit)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    Statement select(database_, "SELECT " JOB_COLUMNS
                                " FROM jobs WHERE state = ? ORDER BY priority DESC, number");
    select.Bind(state);
    jobs::JobPage read;
    while (!limit || std::ssize(read.jobs) < *limit) {
      const auto row = select.Step();
      if (!row.ok()) return row.status();
      if (!*row) break;
      AddToPage(select, damage_, &read);
    }
    return read;
  }

  // The same, without the damaged ones.
  absl::StatusOr<std::vector<v1::Job>> SoundInStateLocked(v1::JobState state,
                                                          std::optional<int> limit)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    auto read = ReadInStateLocked(state, limit);
    if (!read.ok()) return read.status();
    return std::move(read->jobs);
  }

  absl::StatusOr<int> GetAliasLocked(const security::ModelAliasName& name)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    Statement select(database_,
                     "SELECT " ALIAS_COLUMNS " FROM aliases WHERE model = ? AND alias = ?");
    const auto row = select.Bind(name.model).Bind(name.alias).Step();
    if (!row.ok()) return row.status();
    if (!*row) return NoSuchAlias(name);
    const auto alias = AliasFrom(select);
    if (!alias.ok()) return alias.status();
    return alias->version;
  }

  absl::StatusOr<v1::Job> GetLocked(const std::string& name) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    Statement select(database_, "SELECT " JOB_COLUMNS " FROM jobs WHERE name = ?");
    const auto row = select.Bind(name).Step();
    if (!row.ok()) return row.status();
    if (!*row) return NoSuchJob(name);
    return JobFrom(select);
  }

  absl::Status ReplaceLocked(v1::JobState from, const v1::Job& job)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const std::string blob = StoredJob(job);
    Statement update(database_, "UPDATE jobs SET state = ?, job = ? WHERE name = ? AND state = ?");
    update.Bind(job.state()).BindBlob(blob).Bind(job.name()).Bind(from);
    if (absl::Status status = update.Run(); !status.ok()) return status;
    if (sqlite3_changes(database_) == 1) return absl::OkStatus();
    const auto stored = GetLocked(job.name());
    if (!stored.ok()) return stored.status();
    return IsInState(*stored);
  }

  // One connection, one statement at a time.
  Mutex mutex_;
  sqlite3* const database_ ABSL_GUARDED_BY(mutex_);
  // Leases end with this object, which every holder has to call: so they need not be in the file.
  std::map<std::string, int64_t> fences_ ABSL_GUARDED_BY(mutex_);  // by job
  int64_t last_fence_ ABSL_GUARDED_BY(mutex_) = 0;
  DamageLog damage_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<SqliteStore>> SqliteStore::Open(const std::filesystem::path& file) {
  sqlite3* database = nullptr;
  const int result =
      sqlite3_open_v2(file.c_str(), &database,
                      SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, nullptr);
  if (result != SQLITE_OK) {
    absl::Status status = SqliteError(database, result);
    sqlite3_close_v2(database);
    return status;
  }
  auto store = std::make_unique<FileStore>(database);
  const absl::Status status = store->Prepare();
  if (absl::IsDataLoss(status)) {
    return absl::DataLossError(absl::StrCat(
        status.message(), "; ", file.string(),
        " is damaged. Bring it back with maneuverd repair --backup BACKUP: docs/guides/backup.md "
        "says how"));
  }
  if (!status.ok()) return status;
  return store;
}

}  // namespace maneuver::store
