#include "server/jobs/postgresql_store.h"

#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "locks/mutex.h"
#include "server/jobs/job_state.h"
#include "server/jobs/postgresql_session.h"
#include "server/jobs/stored_job.h"

namespace maneuver::jobs {
namespace {

// Columns that JobFrom reads: the job, and its latest event or NULL.
constexpr char kSelectJob[] =
    "SELECT number, job, (SELECT progress FROM progress WHERE job_number = number"
    " ORDER BY sequence DESC LIMIT 1), name, state, fence, request_digest FROM jobs";

absl::StatusOr<v1::Job> JobFrom(const SqlRows& rows, int row) {
  return ParseStoredJob({rows.Bytes(row, 3), rows.Int(row, 4)}, rows.Bytes(row, 1),
                        rows.IsNull(row, 2) ? std::nullopt : std::optional(rows.Bytes(row, 2)));
}

absl::StatusOr<std::vector<v1::Job>> JobsFrom(const absl::StatusOr<SqlRows>& rows) {
  if (!rows.ok()) return rows.status();
  std::vector<v1::Job> jobs;
  for (int row = 0; row < rows->count(); ++row) {
    auto job = JobFrom(*rows, row);
    if (!job.ok()) return job.status();
    jobs.push_back(*std::move(job));
  }
  return jobs;
}

SqlStatement Select(const std::string& where, std::vector<SqlValue> values) {
  return {absl::StrCat(kSelectJob, " WHERE ", where), std::move(values)};
}

// Writes a job over a stored one. Takes it back by the row as it was, if nobody has written since.
absl::Status Replace(PostgresqlConnection& connection, SqlStatement& undo, const SqlRows& before,
                     int64_t fence, const v1::Job& job) {
  undo = {"UPDATE jobs SET state = $1, fence = $2, job = $3 WHERE name = $4 AND job = $5",
          {before.Int(0, 4), before.Int(0, 5), SqlValue::Bytes(before.Bytes(0, 1)), job.name(),
           SqlValue::Bytes(StoredJob(job))}};
  return connection
      .Run("UPDATE jobs SET state = $1, fence = $2, job = $3 WHERE name = $4",
           {job.state(), fence, SqlValue::Bytes(StoredJob(job)), job.name()})
      .status();
}

constexpr char kSelectAliases[] = "SELECT model, alias, version, digest FROM aliases";

absl::StatusOr<serving::ModelAlias> AliasFrom(const SqlRows& rows, int row) {
  return StoredAlias({rows.Bytes(row, 0), rows.Bytes(row, 1)}, rows.Int(row, 2),
                     rows.IsNull(row, 3) ? std::nullopt : std::optional(rows.Int(row, 3)));
}

constexpr char kSetAlias[] =
    "INSERT INTO aliases (model, alias, version, digest) VALUES ($1, $2, $3, $4)"
    " ON CONFLICT (model, alias) DO UPDATE SET version = $3, digest = $4";
constexpr char kDeleteAlias[] = "DELETE FROM aliases WHERE model = $1 AND alias = $2";

class OwnedStore final : public PostgresqlStore {
 public:
  OwnedStore(std::unique_ptr<PostgresqlSession> session, int64_t first_fence)
      : id_(session->store_id()), first_fence_(first_fence), session_(std::move(session)) {}

  const std::string& id() const override { return id_; }

  absl::Status Add(const v1::Job& job, const std::string& request_id,
                   const std::string& request_digest) override {
    return Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
      undo = {"DELETE FROM jobs WHERE name = $1", {job.name()}};
      return connection
          .Run(
              "INSERT INTO jobs (name, state, priority, create_time, request_digest, job,"
              " request_id) VALUES ($1, $2, $3, $4, $5, $6, $7)",
              {job.name(), job.state(), PriorityOf(job), CreateMicros(job),
               SqlValue::Bytes(request_digest), SqlValue::Bytes(StoredJob(job)),
               request_id.empty() ? SqlValue::Null() : SqlValue::Bytes(request_id)})
          .status();
    });
  }

  absl::StatusOr<v1::Job> Get(const std::string& name) override {
    const auto rows = Read(Select("name = $1", {name}));
    if (!rows.ok()) return rows.status();
    return rows->empty() ? NoSuchJob(name) : JobFrom(*rows, 0);
  }

  absl::StatusOr<std::optional<RequestedJob>> FindRequest(const std::string& request_id) override {
    const auto rows = Read(Select("request_id = $1", {SqlValue::Bytes(request_id)}));
    if (!rows.ok()) return rows.status();
    if (rows->empty()) return std::optional<RequestedJob>();
    auto job = JobFrom(*rows, 0);
    if (!job.ok()) return job.status();
    return std::optional<RequestedJob>({*std::move(job), rows->Bytes(0, 6)});
  }

  absl::StatusOr<JobPage> List(int page_size, const std::string& page_token) override {
    const auto before = ParsePageToken(page_token);
    if (!before.ok()) return before.status();
    const auto rows = Read(
        Select("number < $1 ORDER BY number DESC LIMIT $2", {*before, int64_t{page_size} + 1}));
    auto jobs = JobsFrom(rows);
    if (!jobs.ok()) return jobs.status();
    JobPage page = {*std::move(jobs), ""};
    if (page.jobs.size() > static_cast<size_t>(page_size)) {
      page.jobs.pop_back();
      page.next_page_token = absl::StrCat(rows->Int(page_size - 1, 0));
    }
    return page;
  }

  absl::StatusOr<std::vector<v1::Job>> ListInState(v1::JobState state,
                                                   std::optional<int> limit) override {
    return JobsFrom(Read(Select("state = $1 ORDER BY priority DESC, number LIMIT $2",
                                {state, limit ? SqlValue(*limit) : SqlValue::Null()})));
  }

  absl::StatusOr<int64_t> CountInState(v1::JobState state) override {
    const auto rows = Read({"SELECT count(*) FROM jobs WHERE state = $1", {state}});
    if (!rows.ok()) return rows.status();
    return rows->Int(0, 0);
  }

  absl::Status Move(v1::JobState from, const v1::Job& job) override {
    if (absl::Status status = CheckMove(from, job.state()); !status.ok()) return status;
    return Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
      const auto rows = connection.Run(Select("name = $1 FOR UPDATE", {job.name()}));
      if (!rows.ok()) return rows.status();
      if (rows->empty()) return NoSuchJob(job.name());
      const auto stored = JobFrom(*rows, 0);
      if (!stored.ok()) return stored.status();
      if (stored->state() != from) return IsInState(*stored);
      return Replace(connection, undo, *rows, rows->Int(0, 5), job);
    });
  }

  absl::StatusOr<std::optional<ClaimedJob>> Claim(const JobEdit& begin) override {
    std::optional<ClaimedJob> claimed;
    const absl::Status status = Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
      const auto rows = connection.Run(
          Select("state = $1 ORDER BY priority DESC, number LIMIT 1 FOR UPDATE SKIP LOCKED",
                 {v1::JOB_STATE_PENDING}));
      if (!rows.ok()) return rows.status();
      if (rows->empty()) return absl::OkStatus();
      auto job = JobFrom(*rows, 0);
      if (!job.ok()) return job.status();
      job->set_state(v1::JOB_STATE_RUNNING);
      begin(*job);
      const auto fence = connection.Run("SELECT nextval('job_fences')");
      if (!fence.ok()) return fence.status();
      const JobLease lease = {job->name(), fence->Int(0, 0)};
      claimed = ClaimedJob{*std::move(job), lease};
      return Replace(connection, undo, *rows, lease.fence, claimed->job);
    });
    if (!status.ok()) return status;
    return claimed;
  }

  absl::Status Finish(const JobLease& lease, const JobEdit& end) override {
    return Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
      const auto rows = connection.Run(Select("name = $1 AND state = $2 AND fence = $3 FOR UPDATE",
                                              {lease.job, v1::JOB_STATE_RUNNING, lease.fence}));
      if (!rows.ok()) return rows.status();
      if (rows->empty()) return LeaseEnded(lease);
      auto job = JobFrom(*rows, 0);
      if (!job.ok()) return job.status();
      if (absl::Status status = EditRunning(end, *job); !status.ok()) return status;
      return Replace(connection, undo, *rows, lease.fence, *job);
    });
  }

  absl::StatusOr<std::vector<v1::Job>> TakeAbandoned(const JobEdit& end) override {
    std::vector<v1::Job> taken;
    for (;;) {
      bool found = false;
      const absl::Status status = Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
        const auto rows = connection.Run(
            Select("state = $1 AND fence < $2 ORDER BY priority DESC, number LIMIT 1 FOR UPDATE",
                   {v1::JOB_STATE_RUNNING, first_fence_}));
        if (!rows.ok()) return rows.status();
        found = !rows->empty();
        if (!found) return absl::OkStatus();
        auto job = JobFrom(*rows, 0);
        if (!job.ok()) return job.status();
        if (absl::Status edited = EditRunning(end, *job); !edited.ok()) return edited;
        taken.push_back(*job);
        return Replace(connection, undo, *rows, rows->Int(0, 5), *job);
      });
      if (!status.ok()) return status;
      if (!found) return taken;
    }
  }

  absl::StatusOr<v1::Job> RequestCancel(const std::string& name) override {
    v1::Job job;
    const absl::Status status = Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
      const auto rows = connection.Run(Select("name = $1 FOR UPDATE", {name}));
      if (!rows.ok()) return rows.status();
      if (rows->empty()) return NoSuchJob(name);
      const auto stored = JobFrom(*rows, 0);
      if (!stored.ok()) return stored.status();
      if (stored->state() != v1::JOB_STATE_RUNNING) return IsInState(*stored);
      job = *stored;
      job.set_cancel_requested(true);
      return Replace(connection, undo, *rows, rows->Int(0, 5), job);
    });
    if (!status.ok()) return status;
    return job;
  }

  absl::Status AddProgress(const JobLease& lease, const v1::JobProgress& progress) override {
    return Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
      undo = {
          "DELETE FROM progress WHERE sequence = $1"
          " AND job_number = (SELECT number FROM jobs WHERE name = $2)",
          {progress.sequence(), lease.job}};
      // The row stays locked, so that the lease cannot end before the event is there.
      const auto added = connection.Run(
          "WITH held AS (SELECT number FROM jobs WHERE name = $1 AND state = $2 AND fence = $3"
          " FOR SHARE) INSERT INTO progress (job_number, sequence, progress)"
          " SELECT number, $4::int8, $5::bytea FROM held",
          {lease.job, v1::JOB_STATE_RUNNING, lease.fence, progress.sequence(),
           SqlValue::Bytes(StoredProgress(progress))});
      if (!added.ok()) return added.status();
      return added->changed() == 1 ? absl::OkStatus() : LeaseEnded(lease);
    });
  }

  absl::StatusOr<std::vector<v1::JobProgress>> ListProgress(const std::string& name,
                                                            int64_t after_sequence,
                                                            int limit) override {
    const auto rows =
        Read({"SELECT progress FROM progress"
              " WHERE job_number = (SELECT number FROM jobs WHERE name = $1) AND sequence > $2"
              " ORDER BY sequence LIMIT $3",
              {name, after_sequence, limit}});
    if (!rows.ok()) return rows.status();
    std::vector<v1::JobProgress> events;
    for (int row = 0; row < rows->count(); ++row) {
      auto event = ParseStoredProgress(rows->Bytes(row, 0));
      if (!event.ok()) return event.status();
      events.push_back(*std::move(event));
    }
    return events;
  }

  absl::Status Delete(const std::string& name) override {
    return Write([&](PostgresqlConnection& connection, SqlStatement&) {
      const auto rows = connection.Run(Select("name = $1 FOR UPDATE", {name}));
      if (!rows.ok()) return rows.status();
      if (rows->empty()) return NoSuchJob(name);
      const auto job = JobFrom(*rows, 0);
      if (!job.ok()) return job.status();
      if (!HasEnded(job->state())) return NotEnded(*job);
      // Nothing takes this back: a caller that asks again learns that the job is gone.
      return connection.Run("DELETE FROM jobs WHERE name = $1", {name}).status();
    });
  }

  absl::Status SetAlias(const security::ModelAliasName& name, int version) override {
    return Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
      if (absl::Status status = KeepAlias(connection, name, undo); !status.ok()) return status;
      return connection
          .Run(kSetAlias, {name.model, name.alias, version, AliasDigest(name, version)})
          .status();
    });
  }

  absl::StatusOr<int> GetAlias(const security::ModelAliasName& name) override {
    const auto rows = Read({absl::StrCat(kSelectAliases, " WHERE model = $1 AND alias = $2"),
                            {name.model, name.alias}});
    if (!rows.ok()) return rows.status();
    if (rows->empty()) return NoSuchAlias(name);
    const auto alias = AliasFrom(*rows, 0);
    if (!alias.ok()) return alias.status();
    return alias->version;
  }

  absl::StatusOr<std::vector<serving::ModelAlias>> ListAliases() override {
    const auto rows = Read({absl::StrCat(kSelectAliases, " ORDER BY model, alias"), {}});
    if (!rows.ok()) return rows.status();
    std::vector<serving::ModelAlias> aliases;
    for (int row = 0; row < rows->count(); ++row) {
      auto alias = AliasFrom(*rows, row);
      if (!alias.ok()) return alias.status();
      aliases.push_back(*std::move(alias));
    }
    return aliases;
  }

  absl::Status DeleteAlias(const security::ModelAliasName& name) override {
    return Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
      if (absl::Status status = KeepAlias(connection, name, undo); !status.ok()) return status;
      const auto deleted = connection.Run(kDeleteAlias, {name.model, name.alias});
      if (!deleted.ok()) return deleted.status();
      return deleted->changed() == 1 ? absl::OkStatus() : NoSuchAlias(name);
    });
  }

 private:
  // Sets `undo` to what makes the alias what it is now.
  static absl::Status KeepAlias(PostgresqlConnection& connection,
                                const security::ModelAliasName& name, SqlStatement& undo) {
    const auto rows =
        connection.Run(absl::StrCat(kSelectAliases, " WHERE model = $1 AND alias = $2 FOR UPDATE"),
                       {name.model, name.alias});
    if (!rows.ok()) return rows.status();
    undo = {kDeleteAlias, {name.model, name.alias}};
    if (rows->empty()) return absl::OkStatus();
    const auto alias = AliasFrom(*rows, 0);
    if (!alias.ok()) return alias.status();
    undo = {kSetAlias, {name.model, name.alias, alias->version, AliasDigest(name, alias->version)}};
    return absl::OkStatus();
  }

  absl::StatusOr<SqlRows> Read(const SqlStatement& statement) {
    const MutexLock lock(mutex_);
    return session_->Read(statement);
  }
  absl::Status Write(const PostgresqlSession::Change& change) {
    const MutexLock lock(mutex_);
    return session_->Write(change);
  }

  const std::string id_;
  // Leases of earlier owners have smaller fences.
  const int64_t first_fence_;
  // One connection, one transaction at a time.
  Mutex mutex_;
  const std::unique_ptr<PostgresqlSession> session_ ABSL_PT_GUARDED_BY(mutex_);
};

}  // namespace

absl::StatusOr<std::unique_ptr<PostgresqlStore>> PostgresqlStore::Open(
    const std::string& address, monitoring::MetricRegistry& metrics) {
  auto session = PostgresqlSession::Open(address, metrics);
  if (!session.ok()) return session.status();
  const auto first_fence = (*session)->Read({"SELECT nextval('job_fences')", {}});
  if (!first_fence.ok()) return first_fence.status();
  return std::make_unique<OwnedStore>(*std::move(session), first_fence->Int(0, 0));
}

}  // namespace maneuver::jobs
