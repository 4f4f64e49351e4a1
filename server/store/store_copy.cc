#include "server/store/store_copy.h"

#include <chrono>
#include <memory>
#include <optional>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "server/jobs/worker_capacity.h"
#include "server/store/open_store.h"
#include "server/store/postgresql_connection.h"
#include "server/store/postgresql_schema.h"
#include "server/store/postgresql_store.h"
#include "server/store/sqlite_statement.h"
#include "server/store/sqlite_store.h"
#include "server/store/stored_job.h"

namespace maneuver::store {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::seconds kCopyPatience{300};

// SQLite's types are the value's, not the column's: texts come as their bytes.
SqlValue BytesOrNull(const Statement& row, int column) {
  return row.IsNull(column) ? SqlValue::Null() : SqlValue::Bytes(row.Bytes(column));
}

SqlValue IntOrNull(const Statement& row, int column) {
  return row.IsNull(column) ? SqlValue::Null() : SqlValue(row.Int(column));
}

// Calls `insert` with each row of a statement that returns rows.
template <typename Insert>
absl::Status ForEachRow(sqlite3* source, const char* select, Insert insert) {
  Statement statement(source, select);
  for (;;) {
    const auto row = statement.Step();
    if (!row.ok()) return row.status();
    if (!*row) return absl::OkStatus();
    if (const auto inserted = insert(statement); !inserted.ok()) return inserted.status();
  }
}

absl::Status CopyRows(sqlite3* source, PostgresqlConnection& target) {
  absl::Status status = ForEachRow(
      source,
      "SELECT number, name, state, priority, create_time, request_id, request_digest, job FROM "
      "jobs",
      [&](const Statement& row) -> absl::StatusOr<SqlRows> {
        const auto job = ParseStoredJob({row.Bytes(1), row.Int(2)}, row.Bytes(7), std::nullopt);
        if (!job.ok()) return job.status();
        const jobs::JobNeeds needs = jobs::NeedsOf(*job);
        return target.Run(
            "INSERT INTO jobs (number, name, state, priority, create_time, request_id,"
            " request_digest, job, device, ranks, memory)"
            " VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11)",
            {row.Int(0), row.Bytes(1), row.Int(2), row.Int(3), row.Int(4), BytesOrNull(row, 5),
             SqlValue::Bytes(row.Bytes(6)), SqlValue::Bytes(row.Bytes(7)), needs.device,
             needs.ranks, needs.memory_bytes});
      });
  if (!status.ok()) return status;
  status = ForEachRow(
      source, "SELECT job_number, sequence, progress FROM progress", [&](const Statement& row) {
        return target.Run(
            "INSERT INTO progress (job_number, sequence, progress) VALUES ($1, $2, $3)",
            {row.Int(0), row.Int(1), SqlValue::Bytes(row.Bytes(2))});
      });
  if (!status.ok()) return status;
  status = ForEachRow(
      source, "SELECT model, alias, version, digest FROM aliases", [&](const Statement& row) {
        return target.Run(
            "INSERT INTO aliases (model, alias, version, digest) VALUES ($1, $2, $3, $4)",
            {row.Bytes(0), row.Bytes(1), row.Int(2), IntOrNull(row, 3)});
      });
  if (!status.ok()) return status;
  // Numbers of jobs that were deleted are not used again either.
  return ForEachRow(source, "SELECT seq FROM sqlite_sequence WHERE name = 'jobs' AND seq > 0",
                    [&](const Statement& row) {
                      return target.Run(
                          "SELECT setval(pg_get_serial_sequence('jobs', 'number'), $1)",
                          {row.Int(0)});
                    });
}

absl::Status CopyInto(const fs::path& file, PostgresqlConnection& target) {
  sqlite3* source = nullptr;
  const int result = sqlite3_open_v2(file.c_str(), &source, SQLITE_OPEN_READONLY, nullptr);
  const std::unique_ptr<sqlite3, int (*)(sqlite3*)> closed(source, sqlite3_close);
  if (result != SQLITE_OK) return SqliteError(source, result);
  absl::Status status = target.RunScript("BEGIN");
  if (status.ok()) status = CopyRows(source, target);
  if (!status.ok()) return status;  // the end of the connection rolls back
  return target.RunScript("COMMIT");
}

// Copies unless an earlier call has.
absl::Status CopyOnce(const fs::path& data_dir, const std::string& address) {
  const auto target = PostgresqlConnection::Open(address);
  if (!target.ok()) return target.status();
  PostgresqlConnection& connection = **target;
  if (absl::Status status = LockStore(connection, StoreUse::kAlone, kPatienceForPredecessor);
      !status.ok()) {
    return status;
  }
  if (absl::Status status = CheckSchema(connection); !status.ok()) return status;
  if (absl::Status status = connection.SetPatience(kCopyPatience); !status.ok()) return status;
  const auto present = connection.Run(
      "SELECT id, (SELECT count(*) FROM jobs), (SELECT count(*) FROM aliases),"
      " (SELECT count(*) FROM datasets) FROM store");
  if (!present.ok()) return present.status();
  const std::string id = present->Bytes(0, 0);
  const auto bound = StoreIdOf(data_dir);
  if (!bound.ok()) return bound.status();
  if (present->Int(0, 1) + present->Int(0, 2) + present->Int(0, 3) > 0) {
    if (*bound == id) return absl::OkStatus();  // cut off after it was committed
    return absl::FailedPreconditionError(absl::StrCat(
        "the database of --store already holds ", present->Int(0, 1), " jobs, ", present->Int(0, 2),
        " aliases and ", present->Int(0, 3), " datasets; copy into an empty one"));
  }
  // First: if the copy is committed and then cut off, no server starts over the old store.
  if (absl::Status status = WriteStoreId(data_dir, id); !status.ok()) return status;
  absl::Status status = CopyInto(data_dir / kEmbeddedStore, connection);
  if (!status.ok() && !connection.is_broken()) {
    std::error_code ignored;
    fs::remove(data_dir / kStoreId, ignored);
  }
  return status;
}

}  // namespace

absl::StatusOr<StoreContents> CopyStore(const fs::path& data_dir, const std::string& address) {
  const fs::path file = data_dir / kEmbeddedStore;
  std::error_code error;
  if (!fs::exists(file, error)) {
    return absl::NotFoundError(absl::StrCat("there is no ", file.string(), " to copy"));
  }
  StoreContents contents;
  {
    // Brings its tables up to date, too.
    const auto source = SqliteStore::Open(file);
    if (!source.ok()) return source.status();
    auto read = CheckStore(**source);
    if (!read.ok()) return read.status();
    contents = *std::move(read);
  }
  if (absl::Status status = CopyOnce(data_dir, address); !status.ok()) return status;
  const auto target = PostgresqlStore::Open(address);
  if (!target.ok()) return target.status();
  auto copied = CheckStore(**target);
  if (!copied.ok()) return copied.status();
  copied->datasets = contents.datasets;  // the first server adds those of the folder
  if (*copied != contents) {
    return absl::DataLossError(absl::StrCat("the database of --store holds ", copied->ToString(),
                                            ", and ", file.string(), " holds ", contents.ToString(),
                                            "; empty the database, delete ",
                                            (data_dir / kStoreId).string(), " and copy again"));
  }
  fs::rename(file, data_dir / kCopiedStore, error);
  if (error) return files::ErrnoStatus(error.value(), "rename", file);
  if (absl::Status status = files::SyncPath(data_dir); !status.ok()) return status;
  return contents;
}

}  // namespace maneuver::store
