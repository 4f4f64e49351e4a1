#include "server/store/sqlite_schema.h"

#include "absl/strings/str_cat.h"
#include "server/store/sqlite_statement.h"

namespace maneuver::store {
namespace {

constexpr int kSchemaVersion = 3;

constexpr char kSchema[] = R"sql(
  CREATE TABLE jobs (
    number INTEGER PRIMARY KEY AUTOINCREMENT,  -- order of creation; never used twice
    name TEXT NOT NULL UNIQUE,
    state INTEGER NOT NULL,                    -- maneuver.v1.JobState
    priority INTEGER NOT NULL DEFAULT 0,       -- higher first
    create_time INTEGER NOT NULL,              -- microseconds since 1970
    request_id TEXT UNIQUE,                    -- NULL: none
    request_digest TEXT NOT NULL,
    job BLOB NOT NULL                          -- maneuver.v1.Job without progress
  );
  CREATE INDEX jobs_by_turn ON jobs (state, priority DESC, number);
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
    digest INTEGER,                            -- CRC-32C of these; NULL: of an earlier release
    PRIMARY KEY (model, alias)
  ) WITHOUT ROWID;
)sql";

// Version 1 knew no priorities.
constexpr char kFromVersion1[] = R"sql(
  ALTER TABLE jobs ADD COLUMN priority INTEGER NOT NULL DEFAULT 0;
  DROP INDEX jobs_by_state;
  CREATE INDEX jobs_by_turn ON jobs (state, priority DESC, number);
)sql";

// Version 2 could not tell whether an alias was damaged.
constexpr char kFromVersion2[] = "ALTER TABLE aliases ADD COLUMN digest INTEGER";

absl::Status BringUp(sqlite3* database) {
  int64_t version = 0;
  {
    Statement select(database, "PRAGMA user_version");
    if (const auto row = select.Step(); !row.ok()) return row.status();
    version = select.Int(0);
  }
  if (version == kSchemaVersion) return absl::OkStatus();
  if (version < 0 || version > kSchemaVersion) {
    return absl::FailedPreconditionError(absl::StrCat(
        "the job store has schema version ", version, "; this server knows version ",
        kSchemaVersion, ": run the server that wrote it, or give another data folder"));
  }
  absl::Status status;
  if (version == 0) status = Execute(database, kSchema);
  if (version == 1) status = Execute(database, kFromVersion1);
  if (status.ok() && version != 0) status = Execute(database, kFromVersion2);
  if (!status.ok()) return status;
  return Execute(database, absl::StrCat("PRAGMA user_version = ", kSchemaVersion));
}

}  // namespace

absl::Status PrepareSchema(sqlite3* database) {
  if (absl::Status status = Execute(database, "BEGIN IMMEDIATE"); !status.ok()) return status;
  absl::Status status = BringUp(database);
  if (status.ok()) status = Execute(database, "COMMIT");
  if (!status.ok()) Execute(database, "ROLLBACK").IgnoreError();
  return status;
}

}  // namespace maneuver::store
