#include "server/store/postgresql_store.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "locks/mutex.h"
#include "server/jobs/job_state.h"
#include "server/store/postgresql_dataset_ledger.h"
#include "server/store/postgresql_listener.h"
#include "server/store/postgresql_session.h"
#include "server/store/store_unavailable.h"
#include "server/store/stored_job.h"

namespace maneuver::store {
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
  undo = {
      "UPDATE jobs SET state = $1, fence = $2, job = $3 WHERE name = $4 AND job = $5 AND fence = "
      "$6",
      {before.Int(0, 4), before.Int(0, 5), SqlValue::Bytes(before.Bytes(0, 1)), job.name(),
       SqlValue::Bytes(StoredJob(job)), fence}};
  return connection
      .Run("UPDATE jobs SET state = $1, fence = $2, job = $3 WHERE name = $4",
           {job.state(), fence, SqlValue::Bytes(StoredJob(job)), job.name()})
      .status();
}

// Returns an array of texts as PostgreSQL reads it.
std::string ArrayOf(const std::vector<std::string>& texts) {
  return absl::StrCat(
      "{",
      absl::StrJoin(texts, ",",
                    [](std::string* array, const std::string& text) {
                      absl::StrAppend(array, "\"",
                                      absl::StrReplaceAll(text, {{"\\", "\\\\"}, {"\"", "\\\""}}),
                                      "\"");
                    }),
      "}");
}

constexpr char kSelectAliases[] = "SELECT model, alias, version, digest FROM aliases";

absl::StatusOr<serving::ModelAlias> AliasFrom(const SqlRows& rows, int row) {
  return StoredAlias({rows.Bytes(row, 0), rows.Bytes(row, 1)}, rows.Int(row, 2),
                     rows.IsNull(row, 3) ? std::nullopt : std::optional(rows.Int(row, 3)));
}

constexpr char kAddAlias[] =
    "INSERT INTO aliases (model, alias, version, digest) VALUES ($1, $2, $3, $4)"
    " ON CONFLICT (model, alias) DO NOTHING RETURNING xmin::text::int8";
constexpr char kMoveAlias[] =
    "UPDATE aliases SET version = $3, digest = $4 WHERE model = $1 AND alias = $2"
    " RETURNING xmin::text::int8";
constexpr char kDeleteAlias[] = "DELETE FROM aliases WHERE model = $1 AND alias = $2";
// Ends the statement of an undo: only if nobody has written the row since.
constexpr char kIfAsWritten[] = " AND xmin::text::int8 = ";

// States of rows of versions.
constexpr int64_t kReserved = 0;
constexpr int64_t kPresent = 1;
constexpr int64_t kDeleted = 2;

class SessionStore final : public PostgresqlStore,
                           private serving::VersionLedger,
                           private jobs::ReplicaRegistry {
 public:
  SessionStore(std::unique_ptr<PostgresqlSession> session, std::string address, StoreUse use,
               int64_t first_fence, monitoring::Counter* heard)
      : id_(session->store_id()),
        name_(session->name()),
        address_(std::move(address)),
        use_(use),
        first_fence_(first_fence),
        heard_(heard),
        session_(std::move(session)) {}

  serving::VersionLedger* Ledger() override { return this; }
  data::DatasetLedger* Datasets() override { return &datasets_; }
  jobs::ReplicaRegistry* Replicas() override { return IsShared() ? this : nullptr; }
  std::unique_ptr<StoreListener> ListenForModels(std::function<void()> changed) override {
    if (!IsShared()) return nullptr;
    return std::make_unique<PostgresqlListener>(address_, std::move(changed), *heard_);
  }

  const std::string& id() const override { return id_; }

  absl::Status Add(const v1::Job& job, const std::string& request_id,
                   const std::string& request_digest) override {
    const jobs::JobNeeds needs = jobs::NeedsOf(job);
    return Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
      undo = {"DELETE FROM jobs WHERE name = $1 AND job = $2",
              {job.name(), SqlValue::Bytes(StoredJob(job))}};
      return connection
          .Run(
              "INSERT INTO jobs (name, state, priority, create_time, request_digest, job,"
              " request_id, device, ranks, memory)"
              " VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10)",
              {job.name(), job.state(), PriorityOf(job), CreateMicros(job),
               SqlValue::Bytes(request_digest), SqlValue::Bytes(StoredJob(job)),
               request_id.empty() ? SqlValue::Null() : SqlValue::Bytes(request_id), needs.device,
               needs.ranks, needs.memory_bytes})
          .status();
    });
  }

  absl::StatusOr<v1::Job> Get(const std::string& name) override {
    const auto rows = Read(Select("name = $1", {name}));
    if (!rows.ok()) return rows.status();
    return rows->empty() ? NoSuchJob(name) : JobFrom(*rows, 0);
  }

  absl::StatusOr<std::optional<jobs::RequestedJob>> FindRequest(
      const std::string& request_id) override {
    const auto rows = Read(Select("request_id = $1", {SqlValue::Bytes(request_id)}));
    if (!rows.ok()) return rows.status();
    if (rows->empty()) return std::optional<jobs::RequestedJob>();
    auto job = JobFrom(*rows, 0);
    if (!job.ok()) return job.status();
    return std::optional<jobs::RequestedJob>({*std::move(job), rows->Bytes(0, 6)});
  }

  absl::StatusOr<jobs::JobPage> List(int page_size, const std::string& page_token) override {
    const auto before = ParsePageToken(page_token);
    if (!before.ok()) return before.status();
    const auto rows = Read(
        Select("number < $1 ORDER BY number DESC LIMIT $2", {*before, int64_t{page_size} + 1}));
    if (!rows.ok()) return rows.status();
    jobs::JobPage page;
    for (int row = 0; row < std::min(rows->count(), page_size); ++row) {
      AddToPage(JobFrom(*rows, row), rows->Bytes(row, 3), damage_, &page);
    }
    if (rows->count() > page_size) {
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

  absl::StatusOr<std::optional<jobs::ClaimedJob>> Claim(
      const jobs::JobEdit& begin, const std::optional<jobs::WorkerCapacity>& worker) override {
    std::optional<jobs::ClaimedJob> claimed;
    const absl::Status status = Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
      constexpr char kLock[] = "FOR UPDATE SKIP LOCKED";
      const auto rows =
          worker ? FirstSound(connection,
                              "state = $2 AND device = ANY (string_to_array($3, ','))"
                              " AND ranks <= $4 AND memory <= $5",
                              {v1::JOB_STATE_PENDING, absl::StrJoin(worker->devices, ","),
                               worker->ranks, worker->memory_bytes},
                              kLock)
                 : FirstSound(connection, "state = $2", {v1::JOB_STATE_PENDING}, kLock);
      if (!rows.ok()) return rows.status();
      if (rows->empty()) return absl::OkStatus();
      auto job = JobFrom(*rows, 0);
      if (!job.ok()) return job.status();
      job->set_state(v1::JOB_STATE_RUNNING);
      begin(*job);
      const auto fence = connection.Run("SELECT nextval('job_fences')");
      if (!fence.ok()) return fence.status();
      const jobs::JobLease lease = {job->name(), fence->Int(0, 0)};
      claimed = jobs::ClaimedJob{*std::move(job), lease};
      absl::Status replaced = Replace(connection, undo, *rows, lease.fence, claimed->job);
      return replaced.ok() ? Extend(connection, lease).status() : replaced;
    });
    if (!status.ok()) return status;
    return claimed;
  }

  std::optional<std::chrono::milliseconds> LeaseTime() const override {
    return IsShared() ? std::optional<std::chrono::milliseconds>(kLeaseTime) : std::nullopt;
  }

  absl::StatusOr<bool> Renew(const jobs::JobLease& lease) override {
    bool is_cancelled = false;
    const absl::Status status = Write([&](PostgresqlConnection& connection, SqlStatement&) {
      const auto rows = Extend(connection, lease);
      if (!rows.ok()) return rows.status();
      if (rows->empty()) return LeaseEnded(lease);
      const auto job =
          ParseStoredJob({lease.job, v1::JOB_STATE_RUNNING}, rows->Bytes(0, 0), std::nullopt);
      if (job.ok()) is_cancelled = job->cancel_requested();
      return job.status();
    });
    if (!status.ok()) return status;
    return is_cancelled;
  }

  absl::Status Finish(const jobs::JobLease& lease, const jobs::JobEdit& end) override {
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

  absl::StatusOr<std::vector<v1::Job>> TakeAbandoned(const jobs::JobEdit& end) override {
    std::vector<v1::Job> taken;
    for (;;) {
      bool found = false;
      const absl::Status status = Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
        const auto rows =
            IsShared()
                ? FirstSound(connection,
                             "state = $2 AND (lease_end IS NULL OR lease_end < clock_timestamp())",
                             {v1::JOB_STATE_RUNNING}, "FOR UPDATE SKIP LOCKED")
                : FirstSound(connection, "state = $2 AND fence < $3",
                             {v1::JOB_STATE_RUNNING, first_fence_}, "FOR UPDATE");
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

  absl::Status AddProgress(const jobs::JobLease& lease, const v1::JobProgress& progress) override {
    return Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
      undo = {
          "DELETE FROM progress WHERE sequence = $1 AND progress = $2"
          " AND job_number = (SELECT number FROM jobs WHERE name = $3)",
          {progress.sequence(), SqlValue::Bytes(StoredProgress(progress)), lease.job}};
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
        Read({"SELECT sequence, progress FROM progress"
              " WHERE job_number = (SELECT number FROM jobs WHERE name = $1) AND sequence > $2"
              " ORDER BY sequence LIMIT $3",
              {name, after_sequence, limit}});
    if (!rows.ok()) return rows.status();
    std::vector<v1::JobProgress> events;
    for (int row = 0; row < rows->count(); ++row) {
      auto event = ParseStoredProgress(rows->Int(row, 0), rows->Bytes(row, 1));
      if (!event.ok()) return event.status();
      events.push_back(*std::move(event));
    }
    return events;
  }

  absl::StatusOr<std::vector<jobs::JobPosition>> ListPositions(
      const std::vector<std::string>& names) override {
    const auto rows =
        Read({"SELECT name, state, coalesce((SELECT max(sequence) FROM progress"
              " WHERE job_number = number), 0) FROM jobs WHERE name = ANY ($1::text[])",
              {ArrayOf(names)}});
    if (!rows.ok()) return rows.status();
    std::vector<jobs::JobPosition> positions;
    positions.reserve(static_cast<size_t>(rows->count()));
    for (int row = 0; row < rows->count(); ++row) {
      positions.push_back(
          {rows->Bytes(row, 0), static_cast<v1::JobState>(rows->Int(row, 1)), rows->Int(row, 2)});
    }
    return positions;
  }

  absl::Status Delete(const std::string& name) override {
    return Write([&](PostgresqlConnection& connection, SqlStatement&) {
      const auto rows = connection.Run(Select("name = $1 FOR UPDATE", {name}));
      if (!rows.ok()) return rows.status();
      if (rows->empty()) return NoSuchJob(name);
      const auto job = JobFrom(*rows, 0);
      if (!job.ok()) return job.status();
      if (!jobs::HasEnded(job->state())) return NotEnded(*job);
      // Nothing takes this back: a caller that asks again learns that the job is gone.
      return connection.Run("DELETE FROM jobs WHERE name = $1", {name}).status();
    });
  }

  absl::StatusOr<bool> SetAliasIf(const security::ModelAliasName& name, int version,
                                  const serving::AliasCondition& condition) override {
    bool is_moved = false;
    const absl::Status status = Write([&](PostgresqlConnection& connection, SqlStatement& undo) {
      absl::Status held = Hold(connection, condition.maker);
      // Nobody deletes the version meanwhile.
      if (held.ok() && IsShared()) held = HoldVersion(connection, {name.model, version}, "SHARE");
      if (!held.ok()) return held;
      const auto before = FindAlias(connection, name);
      if (!before.ok()) return before.status();
      const int stands = *before ? (*before)->version : 0;
      if (condition.before.value_or(stands) != stands) return absl::OkStatus();
      const auto written =
          connection.Run(*before ? kMoveAlias : kAddAlias,
                         {name.model, name.alias, version, AliasDigest(name, version)});
      if (!written.ok()) return written.status();
      if (written->empty()) {  // another server has just added it
        return condition.before ? absl::OkStatus() : StoreUnavailable("the alias is being set");
      }
      is_moved = true;
      undo = UndoAlias(name, *before, written->Int(0, 0));
      return TellOthers(connection);
    });
    if (!status.ok()) return status;
    return is_moved;
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
      const auto before = FindAlias(connection, name);
      if (!before.ok()) return before.status();
      if (!*before) return NoSuchAlias(name);
      undo = {kAddAlias,
              {name.model, name.alias, (*before)->version, AliasDigest(name, (*before)->version)}};
      const auto deleted = connection.Run(kDeleteAlias, {name.model, name.alias});
      return deleted.ok() ? TellOthers(connection) : deleted.status();
    });
  }

 private:
  using Connection = PostgresqlConnection;
  using ModelVersionName = security::ModelVersionName;

  bool IsShared() const { return use_ == StoreUse::kShared; }

  // Reads and locks the first job, in the order in which pending jobs start, that is not damaged.
  // Logs the damaged ones before it. No row if there is none.
  //   where: of a job, with $2, $3, ... for `values`
  //   lock: "FOR UPDATE", perhaps with more
  absl::StatusOr<SqlRows> FirstSound(Connection& connection, const std::string& where,
                                     const std::vector<SqlValue>& values, const char* lock) {
    std::vector<int64_t> damaged;  // numbers
    for (;;) {
      std::vector<SqlValue> all = {absl::StrCat("{", absl::StrJoin(damaged, ","), "}")};
      all.insert(all.end(), values.begin(), values.end());
      auto rows =
          connection.Run(Select(absl::StrCat("number <> ALL ($1::bigint[]) AND ", where,
                                             " ORDER BY priority DESC, number LIMIT 1 ", lock),
                                std::move(all)));
      if (!rows.ok() || rows->empty()) return rows;
      const auto job = JobFrom(*rows, 0);
      if (job.ok()) return rows;
      damage_.Report(job.status());
      damaged.push_back(rows->Int(0, 0));
    }
  }

  absl::StatusOr<std::vector<Entry>> ListVersions() override {
    const auto rows =
        Read({"SELECT model, version, revision FROM versions WHERE state = $1"
              " ORDER BY model, version",
              {kPresent}});
    if (!rows.ok()) return rows.status();
    std::vector<Entry> entries;
    entries.reserve(static_cast<size_t>(rows->count()));
    for (int row = 0; row < rows->count(); ++row) {
      entries.push_back(
          {{rows->Bytes(row, 0), static_cast<int>(rows->Int(row, 1))}, rows->Int(row, 2)});
    }
    return entries;
  }

  absl::Status Adopt(const std::vector<ModelVersionName>& present) override {
    return AddVersions(present, kPresent);
  }
  absl::Status AdoptDeleted(const std::vector<ModelVersionName>& deleted) override {
    return AddVersions(deleted, kDeleted);
  }

  absl::StatusOr<int> Reserve(const std::string& model, const serving::Maker& maker) override {
    int64_t number = 0;
    const absl::Status status = Write([&](Connection& connection, SqlStatement&) {
      if (absl::Status held = Hold(connection, maker); !held.ok()) return held;
      // One after the other: two would get the same number.
      const auto locked = connection.Run(
          "SELECT 1::int8 FROM pg_advisory_xact_lock("
          "hashtextextended('maneuver ' || current_schema() || ' models/' || $1, 0))",
          {model});
      if (!locked.ok()) return locked.status();
      const auto reserved = connection.Run(
          "INSERT INTO versions (model, version, state)"
          " SELECT $1, coalesce(max(version), 0) + 1, $2::int8 FROM versions WHERE model = $1"
          " RETURNING version",
          {model, kReserved});
      if (reserved.ok()) number = reserved->Int(0, 0);
      return reserved.status();
    });
    if (!status.ok()) return status;
    return static_cast<int>(number);
  }

  absl::Status Announce(const ModelVersionName& name, const serving::Maker& maker) override {
    // Nothing takes this back: the next attempt of the job finds the version.
    return Write([&](Connection& connection, SqlStatement&) {
      if (absl::Status held = Hold(connection, maker); !held.ok()) return held;
      return SetVersionState(connection, name, kReserved, kPresent);
    });
  }

  absl::Status Retract(const ModelVersionName& name) override {
    // Nothing takes this back: a caller that asks again learns that the version is gone.
    return Write([&](Connection& connection, SqlStatement&) {
      if (absl::Status held = HoldVersion(connection, name, "UPDATE"); !held.ok()) return held;
      const auto aliases =
          connection.Run("SELECT 1::int8 FROM aliases WHERE model = $1 AND version = $2 LIMIT 1",
                         {name.model, name.version});
      if (!aliases.ok()) return aliases.status();
      if (!aliases->empty()) return HasAlias(name);
      return SetVersionState(connection, name, kPresent, kDeleted);
    });
  }

  absl::Status Change(const ModelVersionName& name, const serving::Maker& maker,
                      const std::function<absl::Status()>& edit) override {
    return Write([&](Connection& connection, SqlStatement&) {
      absl::Status status = Hold(connection, maker);
      if (status.ok()) status = HoldVersion(connection, name, "UPDATE");
      if (status.ok()) status = edit();
      if (!status.ok()) return status;
      const auto counted = connection.Run(
          "UPDATE versions SET revision = revision + 1 WHERE model = $1 AND version = $2",
          {name.model, name.version});
      return counted.ok() ? TellOthers(connection) : counted.status();
    });
  }

  absl::Status Report(const v1::Replica& replica) override {
    return Write([&](Connection& connection, SqlStatement&) {
      // Those that went without a word.
      const auto gone =
          connection.Run("DELETE FROM replicas WHERE seen < clock_timestamp() - interval '1 hour'");
      if (!gone.ok()) return gone.status();
      return connection
          .Run(
              "INSERT INTO replicas (id, seen, replica) VALUES ($1, clock_timestamp(), $2)"
              " ON CONFLICT (id) DO UPDATE SET seen = excluded.seen, replica = excluded.replica",
              {name_, SqlValue::Bytes(replica.SerializeAsString())})
          .status();
    });
  }

  absl::Status Leave() override {
    return Write([&](Connection& connection, SqlStatement&) {
      return connection.Run("DELETE FROM replicas WHERE id = $1", {name_}).status();
    });
  }

  absl::StatusOr<std::vector<v1::Replica>> ListLive() override {
    const auto rows =
        Read({"SELECT replica FROM replicas"
              " WHERE seen > clock_timestamp() - $1::int8 * interval '1 s'",
              {jobs::kReplicaLife.count()}});
    if (!rows.ok()) return rows.status();
    std::vector<v1::Replica> live;
    for (int row = 0; row < rows->count(); ++row) {
      v1::Replica replica;
      // A later release may write what this one cannot read.
      if (replica.ParseFromString(rows->Bytes(row, 0))) live.push_back(std::move(replica));
    }
    std::ranges::sort(live, {}, [](const v1::Replica& each) { return each.name(); });
    return live;
  }

  absl::StatusOr<std::vector<std::pair<jobs::JobNeeds, int64_t>>> CountPendingNeeds() override {
    const auto rows =
        Read({"SELECT device, ranks, memory, count(*) FROM jobs WHERE state = $1"
              " GROUP BY device, ranks, memory",
              {v1::JOB_STATE_PENDING}});
    if (!rows.ok()) return rows.status();
    std::vector<std::pair<jobs::JobNeeds, int64_t>> needs;
    needs.reserve(static_cast<size_t>(rows->count()));
    for (int row = 0; row < rows->count(); ++row) {
      needs.push_back(
          {{rows->Bytes(row, 0), rows->Int(row, 1), rows->Int(row, 2)}, rows->Int(row, 3)});
    }
    return needs;
  }

  absl::Status AddVersions(const std::vector<ModelVersionName>& names, int64_t state) {
    if (names.empty()) return absl::OkStatus();
    return Write([&](Connection& connection, SqlStatement&) {
      for (const ModelVersionName& name : names) {
        const auto added = connection.Run(
            "INSERT INTO versions (model, version, state) VALUES ($1, $2, $3)"
            " ON CONFLICT DO NOTHING",
            {name.model, name.version, state});
        if (!added.ok()) return added.status();
      }
      return absl::OkStatus();
    });
  }

  absl::Status SetVersionState(Connection& connection, const ModelVersionName& name, int64_t from,
                               int64_t to) const {
    const auto rows = connection.Run(
        "UPDATE versions SET state = $1 WHERE model = $2 AND version = $3 AND state = $4",
        {to, name.model, name.version, from});
    if (!rows.ok()) return rows.status();
    return rows->changed() == 1 ? TellOthers(connection) : NoSuchVersion(name);
  }

  // Tells the servers that share the store of a change of aliases or versions, once it is
  // committed.
  absl::Status TellOthers(Connection& connection) const {
    return IsShared() ? NotifyOfModels(connection) : absl::OkStatus();
  }

  // Keeps a version as it is, for the rest of the transaction. NOT_FOUND if there is none.
  //   strength: of the lock, "SHARE" or "UPDATE"
  static absl::Status HoldVersion(Connection& connection, const ModelVersionName& name,
                                  const char* strength) {
    const auto rows =
        connection.Run(absl::StrCat("SELECT 1::int8 FROM versions"
                                    " WHERE model = $1 AND version = $2 AND state = $3 FOR ",
                                    strength),
                       {name.model, name.version, kPresent});
    if (!rows.ok()) return rows.status();
    return rows->empty() ? NoSuchVersion(name) : absl::OkStatus();
  }

  // Keeps the lease of a maker that has one, for the rest of the transaction. ABORTED if it has
  // ended.
  static absl::Status Hold(Connection& connection, const serving::Maker& maker) {
    if (maker.fence == 0) return absl::OkStatus();
    const auto rows = connection.Run(
        "SELECT 1::int8 FROM jobs WHERE name = $1 AND state = $2 AND fence = $3 FOR SHARE",
        {maker.name, v1::JOB_STATE_RUNNING, maker.fence});
    if (!rows.ok()) return rows.status();
    return rows->empty() ? LeaseEnded({maker.name, maker.fence}) : absl::OkStatus();
  }

  // Sets the end of a lease. Returns the job; no row if the lease has ended.
  absl::StatusOr<SqlRows> Extend(Connection& connection, const jobs::JobLease& lease) const {
    return connection.Run(
        "UPDATE jobs SET lease_end = clock_timestamp() + $1::int8 * interval '1 ms'"
        " WHERE name = $2 AND state = $3 AND fence = $4 RETURNING job",
        {IsShared() ? SqlValue(std::chrono::milliseconds(kLeaseTime).count()) : SqlValue::Null(),
         lease.job, v1::JOB_STATE_RUNNING, lease.fence});
  }

  // Returns an alias, which stays as it is for the rest of the transaction.
  static absl::StatusOr<std::optional<serving::ModelAlias>> FindAlias(
      Connection& connection, const security::ModelAliasName& name) {
    const auto rows =
        connection.Run(absl::StrCat(kSelectAliases, " WHERE model = $1 AND alias = $2 FOR UPDATE"),
                       {name.model, name.alias});
    if (!rows.ok()) return rows.status();
    if (rows->empty()) return std::optional<serving::ModelAlias>();
    auto alias = AliasFrom(*rows, 0);
    if (!alias.ok()) return alias.status();
    return std::optional(*std::move(alias));
  }

  // Returns what makes an alias what it was, if its row is still the one that `transaction` wrote.
  static SqlStatement UndoAlias(const security::ModelAliasName& name,
                                const std::optional<serving::ModelAlias>& before,
                                int64_t transaction) {
    if (!before) {
      return {absl::StrCat(kDeleteAlias, kIfAsWritten, "$3"),
              {name.model, name.alias, transaction}};
    }
    return {
        absl::StrCat("UPDATE aliases SET version = $3, digest = $4"
                     " WHERE model = $1 AND alias = $2",
                     kIfAsWritten, "$5"),
        {name.model, name.alias, before->version, AliasDigest(name, before->version), transaction}};
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
  const std::string name_;  // of this server, among those that share the store
  const std::string address_;
  const StoreUse use_;
  // Leases of earlier owners have smaller fences.
  const int64_t first_fence_;
  DamageLog damage_;
  monitoring::Counter* const heard_;  // notifications; nullptr if the store is not shared
  // One connection, one transaction at a time.
  Mutex mutex_;
  const std::unique_ptr<PostgresqlSession> session_ ABSL_PT_GUARDED_BY(mutex_);
  PostgresqlDatasetLedger datasets_{
      [this](const SqlStatement& statement) { return Read(statement); },
      [this](const PostgresqlSession::Change& change) { return Write(change); }};
};

absl::StatusOr<std::unique_ptr<PostgresqlStore>> OpenSession(const std::string& address,
                                                             StoreUse use,
                                                             monitoring::MetricRegistry& metrics) {
  auto session = PostgresqlSession::Open(address, use, metrics);
  if (!session.ok()) return session.status();
  const auto first_fence = (*session)->Read({"SELECT nextval('job_fences')", {}});
  if (!first_fence.ok()) return first_fence.status();
  monitoring::Counter* const heard =
      use == StoreUse::kShared
          ? &metrics.AddCounter("maneuver_store_notifications_total",
                                "Changes of aliases or versions that the database of --store told.")
          : nullptr;
  return std::make_unique<SessionStore>(*std::move(session), address, use, first_fence->Int(0, 0),
                                        heard);
}

}  // namespace

absl::StatusOr<std::unique_ptr<PostgresqlStore>> PostgresqlStore::Open(
    const std::string& address, monitoring::MetricRegistry& metrics) {
  return OpenSession(address, StoreUse::kAlone, metrics);
}

absl::StatusOr<std::unique_ptr<PostgresqlStore>> PostgresqlStore::Share(
    const std::string& address, monitoring::MetricRegistry& metrics) {
  return OpenSession(address, StoreUse::kShared, metrics);
}

}  // namespace maneuver::store
