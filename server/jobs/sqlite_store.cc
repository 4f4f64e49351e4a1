#include "server/jobs/sqlite_store.h"

#include <sqlite3.h>

#include <limits>
#include <mutex>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "server/jobs/job_state.h"

namespace maneuver::jobs {
namespace {

constexpr int kSchemaVersion = 1;
// Long enough for a predecessor that is shutting down.
constexpr int kBusyTimeoutMs = 1'000;

constexpr char kSchema[] = R"sql(
  CREATE TABLE jobs (
    number INTEGER PRIMARY KEY AUTOINCREMENT,  -- order of creation; never used twice
    name TEXT NOT NULL UNIQUE,
    state INTEGER NOT NULL,                    -- maneuver.v1.JobState
    create_time INTEGER NOT NULL,              -- microseconds since 1970
    request_id TEXT UNIQUE,                    -- NULL: none
    request_digest TEXT NOT NULL,
    job BLOB NOT NULL                          -- maneuver.v1.Job without progress
  );
  CREATE INDEX jobs_by_state ON jobs (state, number);
  CREATE TABLE progress (
    job_number INTEGER NOT NULL REFERENCES jobs (number) ON DELETE CASCADE,
    sequence INTEGER NOT NULL,
    progress BLOB NOT NULL,                    -- maneuver.v1.JobProgress
    PRIMARY KEY (job_number, sequence)
  ) WITHOUT ROWID;
  CREATE TABLE aliases (
    model TEXT NOT NULL,
    alias TEXT NOT NULL,
    version INTEGER NOT NULL,
    PRIMARY KEY (model, alias)
  ) WITHOUT ROWID;
)sql";

// Columns that JobFrom reads: the job, and its latest event or NULL.
#define JOB_COLUMNS                                                                          \
  "number, job, (SELECT progress FROM progress WHERE job_number = number ORDER BY sequence " \
  "DESC LIMIT 1)"

absl::Status SqliteError(sqlite3* database, int result) {
  const std::string reason = absl::StrCat(
      "the job store: ", database != nullptr ? sqlite3_errmsg(database) : sqlite3_errstr(result));
  switch (result & 0xff) {
    case SQLITE_FULL:
      return absl::ResourceExhaustedError(absl::StrCat(reason, "; free some disk space"));
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return absl::UnavailableError("the job store is in use by another process");
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return absl::DataLossError(reason);
    case SQLITE_CONSTRAINT:
      return absl::AlreadyExistsError(reason);
    default:
      return absl::UnavailableError(reason);
  }
}

// One prepared statement, run once.
class Statement {
 public:
  Statement(sqlite3* database, const char* sql) : database_(database) {
    result_ = sqlite3_prepare_v2(database, sql, -1, &statement_, nullptr);
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& Bind(int64_t value) {
    if (result_ == SQLITE_OK) result_ = sqlite3_bind_int64(statement_, ++bound_, value);
    return *this;
  }
  // The text must live as long as the statement.
  Statement& Bind(const std::string& text) {
    if (result_ == SQLITE_OK) {
      result_ = sqlite3_bind_text64(statement_, ++bound_, text.data(), text.size(), SQLITE_STATIC,
                                    SQLITE_UTF8);
    }
    return *this;
  }
  Statement& BindBlob(const std::string& bytes) {
    if (result_ == SQLITE_OK) {
      result_ =
          sqlite3_bind_blob64(statement_, ++bound_, bytes.data(), bytes.size(), SQLITE_STATIC);
    }
    return *this;
  }
  Statement& BindNull() {
    if (result_ == SQLITE_OK) result_ = sqlite3_bind_null(statement_, ++bound_);
    return *this;
  }

  // Whether there is a row.
  absl::StatusOr<bool> Step() {
    if (result_ == SQLITE_OK || result_ == SQLITE_ROW) result_ = sqlite3_step(statement_);
    if (result_ == SQLITE_ROW) return true;
    if (result_ == SQLITE_DONE) return false;
    return SqliteError(database_, result_);
  }
  absl::Status Run() { return Step().status(); }

  int64_t Int(int column) const { return sqlite3_column_int64(statement_, column); }
  bool IsNull(int column) const { return sqlite3_column_type(statement_, column) == SQLITE_NULL; }
  std::string Bytes(int column) const {
    const void* data = sqlite3_column_blob(statement_, column);
    const int size = sqlite3_column_bytes(statement_, column);
    return data == nullptr ? std::string()
                           : std::string(static_cast<const char*>(data), static_cast<size_t>(size));
  }

 private:
  sqlite3* const database_;
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0;
  int result_;
};

absl::Status NoSuchJob(const std::string& name) {
  return absl::NotFoundError(absl::StrCat("there is no ", name));
}

absl::StatusOr<v1::Job> JobFrom(const Statement& row) {
  v1::Job job;
  if (!job.ParseFromString(row.Bytes(1)) ||
      (!row.IsNull(2) && !job.mutable_progress()->ParseFromString(row.Bytes(2)))) {
    return absl::DataLossError("the job store holds a job that does not parse");
  }
  return job;
}

std::string Label(v1::JobState state) { return std::string(JobStateLabel(state)); }

// What goes into the job column.
std::string WithoutProgress(v1::Job job) {
  job.clear_progress();
  return job.SerializeAsString();
}

int64_t Micros(const google::protobuf::Timestamp& time) {
  return time.seconds() * 1'000'000 + time.nanos() / 1'000;
}

class Store final : public SqliteStore {
 public:
  explicit Store(sqlite3* database) : database_(database) {}
  ~Store() override { sqlite3_close_v2(database_); }

  absl::Status Prepare() {
    sqlite3_extended_result_codes(database_, 1);
    sqlite3_busy_timeout(database_, kBusyTimeoutMs);
    for (const char* pragma : {"PRAGMA locking_mode = EXCLUSIVE", "PRAGMA journal_mode = WAL",
                               "PRAGMA synchronous = FULL", "PRAGMA foreign_keys = ON"}) {
      if (absl::Status status = Execute(pragma); !status.ok()) return status;
    }
    return Transact([this] {
      Statement version(database_, "PRAGMA user_version");
      const auto row = version.Step();
      if (!row.ok()) return row.status();
      if (version.Int(0) == kSchemaVersion) return absl::OkStatus();
      if (version.Int(0) != 0) {
        return absl::FailedPreconditionError(absl::StrCat(
            "the job store has schema version ", version.Int(0), "; this server knows version ",
            kSchemaVersion, ": run the server that wrote it, or give another data folder"));
      }
      if (absl::Status status = Execute(kSchema); !status.ok()) return status;
      return Execute(absl::StrCat("PRAGMA user_version = ", kSchemaVersion).c_str());
    });
  }

  absl::Status Add(const v1::Job& job, const std::string& request_id,
                   const std::string& request_digest) override {
    const std::lock_guard lock(mutex_);
    const std::string blob = WithoutProgress(job);
    Statement insert(database_,
                     "INSERT INTO jobs (name, state, create_time, request_digest, job, request_id) "
                     "VALUES (?, ?, ?, ?, ?, ?)");
    insert.Bind(job.name()).Bind(job.state()).Bind(Micros(job.create_time())).Bind(request_digest);
    insert.BindBlob(blob);
    request_id.empty() ? insert.BindNull() : insert.Bind(request_id);
    return insert.Run();
  }

  absl::StatusOr<v1::Job> Get(const std::string& name) override {
    const std::lock_guard lock(mutex_);
    return GetLocked(name);
  }

  absl::StatusOr<std::optional<RequestedJob>> FindRequest(const std::string& request_id) override {
    const std::lock_guard lock(mutex_);
    Statement select(database_,
                     "SELECT " JOB_COLUMNS ", request_digest FROM jobs WHERE request_id = ?");
    const auto row = select.Bind(request_id).Step();
    if (!row.ok()) return row.status();
    if (!*row) return std::optional<RequestedJob>();
    auto job = JobFrom(select);
    if (!job.ok()) return job.status();
    return std::optional<RequestedJob>({*std::move(job), select.Bytes(3)});
  }

  absl::StatusOr<JobPage> List(int page_size, const std::string& page_token) override {
    int64_t before = std::numeric_limits<int64_t>::max();
    if (!page_token.empty() && (!absl::SimpleAtoi(page_token, &before) || before < 1)) {
      return absl::InvalidArgumentError("page_token: expected the next_page_token of a response");
    }
    const std::lock_guard lock(mutex_);
    Statement select(database_, "SELECT " JOB_COLUMNS
                                " FROM jobs WHERE number < ? ORDER BY number DESC LIMIT ?");
    select.Bind(before).Bind(int64_t{page_size} + 1);
    JobPage page;
    int64_t last = 0;
    for (;;) {
      const auto row = select.Step();
      if (!row.ok()) return row.status();
      if (!*row) return page;
      if (page.jobs.size() == static_cast<size_t>(page_size)) {
        page.next_page_token = absl::StrCat(last);
        return page;
      }
      auto job = JobFrom(select);
      if (!job.ok()) return job.status();
      last = select.Int(0);
      page.jobs.push_back(*std::move(job));
    }
  }

  absl::StatusOr<std::vector<v1::Job>> ListInState(v1::JobState state,
                                                   std::optional<int> limit) override {
    const std::lock_guard lock(mutex_);
    Statement select(database_,
                     "SELECT " JOB_COLUMNS " FROM jobs WHERE state = ? ORDER BY number LIMIT ?");
    select.Bind(state).Bind(limit.value_or(-1));
    std::vector<v1::Job> jobs;
    for (;;) {
      const auto row = select.Step();
      if (!row.ok()) return row.status();
      if (!*row) return jobs;
      auto job = JobFrom(select);
      if (!job.ok()) return job.status();
      jobs.push_back(*std::move(job));
    }
  }

  absl::StatusOr<int64_t> CountInState(v1::JobState state) override {
    const std::lock_guard lock(mutex_);
    Statement count(database_, "SELECT COUNT(*) FROM jobs WHERE state = ?");
    const auto row = count.Bind(state).Step();
    if (!row.ok()) return row.status();
    return count.Int(0);
  }

  absl::Status Move(v1::JobState from, const v1::Job& job) override {
    const std::lock_guard lock(mutex_);
    if (!CanMove(from, job.state())) {
      return absl::FailedPreconditionError(
          absl::StrCat("a job that is ", Label(from), " cannot become ", Label(job.state())));
    }
    const std::string blob = WithoutProgress(job);
    Statement update(database_, "UPDATE jobs SET state = ?, job = ? WHERE name = ? AND state = ?");
    update.Bind(job.state()).BindBlob(blob).Bind(job.name()).Bind(from);
    if (absl::Status status = update.Run(); !status.ok()) return status;
    if (sqlite3_changes(database_) == 1) return absl::OkStatus();
    const auto stored = GetLocked(job.name());
    if (!stored.ok()) return stored.status();
    return absl::FailedPreconditionError(absl::StrCat(job.name(), " is ", Label(stored->state())));
  }

  absl::Status AddProgress(const std::string& name, const v1::JobProgress& progress) override {
    const std::lock_guard lock(mutex_);
    const std::string blob = progress.SerializeAsString();
    Statement insert(database_,
                     "INSERT INTO progress (sequence, progress, job_number) "
                     "SELECT ?, ?, number FROM jobs WHERE name = ?");
    insert.Bind(progress.sequence()).BindBlob(blob).Bind(name);
    if (absl::Status status = insert.Run(); !status.ok()) return status;
    return sqlite3_changes(database_) == 1 ? absl::OkStatus() : NoSuchJob(name);
  }

  absl::StatusOr<std::vector<v1::JobProgress>> ListProgress(const std::string& name,
                                                            int64_t after_sequence,
                                                            int limit) override {
    const std::lock_guard lock(mutex_);
    Statement select(database_,
                     "SELECT progress FROM progress "
                     "WHERE job_number = (SELECT number FROM jobs WHERE name = ?) AND sequence > ? "
                     "ORDER BY sequence LIMIT ?");
    select.Bind(name).Bind(after_sequence).Bind(limit);
    std::vector<v1::JobProgress> events;
    for (;;) {
      const auto row = select.Step();
      if (!row.ok()) return row.status();
      if (!*row) return events;
      if (!events.emplace_back().ParseFromString(select.Bytes(0))) {
        return absl::DataLossError("the job store holds an event that does not parse");
      }
    }
  }

  absl::Status Delete(const std::string& name) override {
    const std::lock_guard lock(mutex_);
    const auto job = GetLocked(name);
    if (!job.ok()) return job.status();
    if (!HasEnded(job->state())) {
      return absl::FailedPreconditionError(
          absl::StrCat(name, " is ", Label(job->state()), "; cancel it first"));
    }
    return Statement(database_, "DELETE FROM jobs WHERE name = ?").Bind(name).Run();
  }

  absl::Status SetAlias(const security::ModelAliasName& name, int version) override {
    const std::lock_guard lock(mutex_);
    Statement replace(database_,
                      "INSERT OR REPLACE INTO aliases (model, alias, version) VALUES (?, ?, ?)");
    return replace.Bind(name.model).Bind(name.alias).Bind(version).Run();
  }

  absl::StatusOr<int> GetAlias(const security::ModelAliasName& name) override {
    const std::lock_guard lock(mutex_);
    Statement select(database_, "SELECT version FROM aliases WHERE model = ? AND alias = ?");
    const auto row = select.Bind(name.model).Bind(name.alias).Step();
    if (!row.ok()) return row.status();
    if (!*row) return NoSuchAlias(name);
    return static_cast<int>(select.Int(0));
  }

  absl::StatusOr<std::vector<serving::ModelAlias>> ListAliases() override {
    const std::lock_guard lock(mutex_);
    Statement select(database_, "SELECT model, alias, version FROM aliases ORDER BY model, alias");
    std::vector<serving::ModelAlias> aliases;
    for (;;) {
      const auto row = select.Step();
      if (!row.ok()) return row.status();
      if (!*row) return aliases;
      aliases.push_back({{select.Bytes(0), select.Bytes(1)}, static_cast<int>(select.Int(2))});
    }
  }

  absl::Status DeleteAlias(const security::ModelAliasName& name) override {
    const std::lock_guard lock(mutex_);
    Statement remove(database_, "DELETE FROM aliases WHERE model = ? AND alias = ?");
    if (absl::Status status = remove.Bind(name.model).Bind(name.alias).Run(); !status.ok()) {
      return status;
    }
    return sqlite3_changes(database_) == 1 ? absl::OkStatus() : NoSuchAlias(name);
  }

 private:
  static absl::Status NoSuchAlias(const security::ModelAliasName& name) {
    return absl::NotFoundError(absl::StrCat("there is no ", name.ToString()));
  }

  absl::Status Execute(const char* sql) {
    const int result = sqlite3_exec(database_, sql, nullptr, nullptr, nullptr);
    return result == SQLITE_OK ? absl::OkStatus() : SqliteError(database_, result);
  }

  // All of `work` or nothing.
  template <typename Work>
  absl::Status Transact(Work work) {
    if (absl::Status status = Execute("BEGIN IMMEDIATE"); !status.ok()) return status;
    absl::Status status = work();
    if (status.ok()) status = Execute("COMMIT");
    if (!status.ok()) Execute("ROLLBACK").IgnoreError();
    return status;
  }

  absl::StatusOr<v1::Job> GetLocked(const std::string& name) {
    Statement select(database_, "SELECT " JOB_COLUMNS " FROM jobs WHERE name = ?");
    const auto row = select.Bind(name).Step();
    if (!row.ok()) return row.status();
    if (!*row) return NoSuchJob(name);
    return JobFrom(select);
  }

  sqlite3* const database_;
  // One connection, one statement at a time.
  std::mutex mutex_;
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
  auto store = std::make_unique<Store>(database);
  if (absl::Status status = store->Prepare(); !status.ok()) return status;
  return store;
}

}  // namespace maneuver::jobs
