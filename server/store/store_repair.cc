#include "server/store/store_repair.h"

#include <sqlite3.h>

#include <memory>
#include <optional>
#include <system_error>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "server/store/open_store.h"
#include "server/store/sqlite_statement.h"
#include "server/store/sqlite_store.h"
#include "server/store/stored_job.h"

namespace maneuver::store {
namespace {

namespace fs = std::filesystem;

constexpr char kRepaired[] = ".maneuver.db.repaired";  // until it is whole
constexpr char kReadCopy[] = ".maneuver.db.read";      // what SQLite reads, and may change
constexpr const char* kJournals[] = {"-wal", "-shm"};

using Database = std::unique_ptr<sqlite3, int (*)(sqlite3*)>;

absl::StatusOr<Database> OpenDatabase(const fs::path& file) {
  sqlite3* opened = nullptr;
  const int result = sqlite3_open_v2(file.c_str(), &opened, SQLITE_OPEN_READWRITE, nullptr);
  Database database(opened, sqlite3_close);
  if (result != SQLITE_OK) return SqliteError(opened, result);
  return database;
}

void RemoveDatabase(const fs::path& file) {
  std::error_code ignored;
  fs::remove(file, ignored);
  for (const char* journal : kJournals) fs::remove(file.string() + journal, ignored);
}

absl::Status CopyFile(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::copy_file(from, to, fs::copy_options::overwrite_existing, error);
  return error ? files::ErrnoStatus(error.value(), "copy", from) : absl::OkStatus();
}

absl::StatusOr<StoreContents> CheckFile(const fs::path& file) {
  const auto store = SqliteStore::Open(file);
  if (!store.ok()) return store.status();
  return CheckStore(**store);
}

// Returns the SHA-256 that a back-up states for its store.
absl::StatusOr<std::string> StatedDigest(const fs::path& backup) {
  const auto sums = files::ReadFile(backup / "SHA256SUMS");
  if (sums.ok()) {
    for (const absl::string_view line : absl::StrSplit(*sums, '\n')) {
      if (absl::EndsWith(line, absl::StrCat("  ./", kEmbeddedStore))) {
        return std::string(line.substr(0, line.find(' ')));
      }
    }
  }
  return absl::InvalidArgumentError(
      absl::StrCat(backup.string(), " is not a back-up of a data folder with a ", kEmbeddedStore,
                   ": its SHA256SUMS does not name one"));
}

// Copies the store of a back-up to `file`, or makes an empty one, with the tables of this release.
absl::Status Begin(const fs::path& backup, const fs::path& file) {
  if (!backup.empty()) {
    const auto stated = StatedDigest(backup);
    if (!stated.ok()) return stated.status();
    if (absl::Status status = CopyFile(backup / kEmbeddedStore, file); !status.ok()) return status;
    const auto digest = files::Sha256OfFile(file);
    if (!digest.ok()) return digest.status();
    if (*digest != *stated) {
      return absl::DataLossError(absl::StrCat(kEmbeddedStore, " of ", backup.string(),
                                              " is not what its SHA256SUMS says: take an earlier "
                                              "back-up"));
    }
  }
  return CheckFile(file).status();
}

// Calls `take` with each row of a table that can be read: from its begin until the first damaged
// page, and from its end until the last one.
template <typename Take>
absl::Status ForEachReadableRow(sqlite3* damaged, const std::string& select,
                                const std::string& order, Take take) {
  for (const bool descends : {false, true}) {
    const std::string direction = descends ? " DESC" : "";
    const std::string sql = absl::StrCat(select, " ORDER BY ", order, direction);
    Statement rows(damaged, sql.c_str());
    for (;;) {
      const auto row = rows.Step();
      if (!row.ok()) break;
      if (!*row) return absl::OkStatus();
      if (absl::Status status = take(rows); !status.ok()) return status;
    }
  }
  return absl::OkStatus();
}

absl::Status TakeJobs(sqlite3* damaged, sqlite3* repaired, StoreRepair* repair) {
  absl::Status status = ForEachReadableRow(
      damaged,
      "SELECT number, name, state, priority, create_time, request_id, request_digest, job "
      "FROM jobs NOT INDEXED",
      "number", [&](const Statement& row) {
        const std::string name = row.Bytes(1);
        const std::string job = row.Bytes(7);
        if (!ParseStoredJob({name, row.Int(2)}, job, std::nullopt).ok()) return absl::OkStatus();
        const std::string request_id = row.Bytes(5);
        const std::string request_digest = row.Bytes(6);
        Statement insert(repaired,
                         "INSERT INTO jobs (number, state, priority, create_time, name, "
                         "request_digest, job, request_id) VALUES (?, ?, ?, ?, ?, ?, ?, ?) "
                         "ON CONFLICT (name) DO UPDATE SET state = excluded.state, "
                         "priority = excluded.priority, job = excluded.job");
        insert.Bind(row.Int(0)).Bind(row.Int(2)).Bind(row.Int(3)).Bind(row.Int(4));
        insert.Bind(name).Bind(request_digest).BindBlob(job);
        row.IsNull(5) ? insert.BindNull() : insert.Bind(request_id);
        const absl::Status inserted = insert.Run();
        // Another job of the back-up has its number or its request: a column beside it is damaged.
        if (absl::IsAlreadyExists(inserted)) return absl::OkStatus();
        if (inserted.ok()) ++repair->readable_jobs;
        return inserted;
      });
  if (!status.ok()) return status;
  return ForEachReadableRow(
      damaged, "SELECT job_number, sequence, progress FROM progress", "job_number, sequence",
      [&](const Statement& row) {
        const std::string progress = row.Bytes(2);
        if (!ParseStoredProgress(row.Int(1), progress).ok()) return absl::OkStatus();
        Statement insert(repaired,
                         "INSERT OR IGNORE INTO progress (job_number, sequence, progress) "
                         "SELECT ?1, ?2, ?3 WHERE EXISTS (SELECT 1 FROM jobs WHERE number = ?1)");
        return insert.Bind(row.Int(0)).Bind(row.Int(1)).BindBlob(progress).Run();
      });
}

absl::Status TakeAliases(sqlite3* damaged, sqlite3* repaired, StoreRepair* repair) {
  return ForEachReadableRow(
      damaged, "SELECT model, alias, version, digest FROM aliases", "model, alias",
      [&](const Statement& row) {
        const security::ModelAliasName name = {row.Bytes(0), row.Bytes(1)};
        const auto digest = row.IsNull(3) ? std::nullopt : std::optional(row.Int(3));
        // Rows of early releases have no digest: nobody can tell whether they are whole.
        if (!digest || !StoredAlias(name, row.Int(2), digest).ok()) return absl::OkStatus();
        Statement replace(repaired,
                          "INSERT OR REPLACE INTO aliases (model, alias, version, digest) "
                          "VALUES (?, ?, ?, ?)");
        ++repair->readable_aliases;
        return replace.Bind(name.model).Bind(name.alias).Bind(row.Int(2)).Bind(*digest).Run();
      });
}

// Adds what can be read in `damaged`, a copy, to `repaired`.
absl::Status TakeReadable(const fs::path& damaged_file, const fs::path& repaired_file,
                          StoreRepair* repair) {
  const auto damaged = OpenDatabase(damaged_file);
  if (!damaged.ok()) return absl::OkStatus();  // nothing of it
  const auto repaired = OpenDatabase(repaired_file);
  if (!repaired.ok()) return repaired.status();
  absl::Status status = Execute(repaired->get(), "BEGIN IMMEDIATE");
  if (status.ok()) status = TakeJobs(damaged->get(), repaired->get(), repair);
  if (status.ok()) status = TakeAliases(damaged->get(), repaired->get(), repair);
  if (!status.ok()) return status;  // closing rolls back
  return Execute(repaired->get(), "COMMIT");
}

// An alias may point to a version that was deleted after the back-up.
absl::Status DropAliasesOfNothing(const fs::path& data_dir, SqliteStore& store,
                                  StoreRepair* repair) {
  const auto aliases = store.ListAliases();
  if (!aliases.ok()) return aliases.status();
  for (const auto& [name, version] : *aliases) {
    std::error_code ignored;
    if (fs::exists(data_dir / "models" / name.model / absl::StrCat(version), ignored)) continue;
    if (absl::Status status = store.DeleteAlias(name); !status.ok()) return status;
    repair->dropped_aliases.push_back(name.ToString());
  }
  return absl::OkStatus();
}

fs::path UnusedName(const fs::path& file) {
  std::error_code ignored;
  fs::path name = file.string() + ".damaged";
  for (int number = 2; fs::exists(name, ignored); ++number) {
    name = absl::StrCat(file.string(), ".damaged-", number);
  }
  return name;
}

// Puts `repaired` in the place of `file`, which stays as repair->damaged_file.
absl::Status Exchange(const fs::path& file, const fs::path& repaired, StoreRepair* repair) {
  repair->damaged_file = UnusedName(file);
  std::error_code error;
  fs::create_hard_link(file, repair->damaged_file, error);
  if (error) return files::ErrnoStatus(error.value(), "keep", file);
  // First: the journal of the damaged store must not be applied to the repaired one.
  for (const char* journal : kJournals) {
    if (!fs::exists(file.string() + journal, error)) continue;
    fs::rename(file.string() + journal, repair->damaged_file.string() + journal, error);
    if (error) return files::ErrnoStatus(error.value(), "move", file.string() + journal);
  }
  if (absl::Status status = files::SyncPath(repaired); !status.ok()) return status;
  fs::rename(repaired, file, error);
  if (error) return files::ErrnoStatus(error.value(), "replace", file);
  return files::SyncPath(file.parent_path());
}

}  // namespace

absl::StatusOr<StoreRepair> RepairStore(const fs::path& data_dir, const fs::path& backup) {
  const fs::path file = data_dir / kEmbeddedStore;
  const fs::path repaired = data_dir / kRepaired;
  const fs::path copy = data_dir / kReadCopy;
  std::error_code error;
  if (!fs::exists(file, error)) {
    return absl::NotFoundError(absl::StrCat("there is no ", file.string(), " to repair"));
  }
  StoreRepair repair;
  // A copy is read: SQLite may change what it reads, and its journal.
  RemoveDatabase(copy);
  RemoveDatabase(repaired);
  absl::Status status = CopyFile(file, copy);
  const std::string journal = file.string() + "-wal";
  if (status.ok() && fs::exists(journal, error)) {
    status = CopyFile(journal, copy.string() + "-wal");
  }
  if (status.ok()) {
    const auto contents = CheckFile(copy);
    if (contents.ok()) {
      repair.contents = *contents;
    } else if (absl::IsDataLoss(contents.status())) {
      // Without what it says about the copy, and what to do.
      const std::string message(contents.status().message());
      repair.damage = message.substr(0, message.find("; " + copy.string()));
    } else {
      status = contents.status();
    }
  }
  if (status.ok() && !repair.damage.empty()) {
    status = Begin(backup, repaired);
    if (status.ok()) status = TakeReadable(copy, repaired, &repair);
    if (status.ok()) {
      const auto store = SqliteStore::Open(repaired);
      status = store.ok() ? DropAliasesOfNothing(data_dir, **store, &repair) : store.status();
    }
    if (status.ok()) {
      const auto contents = CheckFile(repaired);
      status = contents.status();
      if (status.ok()) repair.contents = *contents;
    }
    if (status.ok()) status = Exchange(file, repaired, &repair);
  }
  RemoveDatabase(copy);
  RemoveDatabase(repaired);
  if (!status.ok()) return status;
  return repair;
}

}  // namespace maneuver::store
