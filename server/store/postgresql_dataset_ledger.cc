#include "server/store/postgresql_dataset_ledger.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/security/resource_name.h"
#include "server/store/stored_job.h"

namespace maneuver::store {
namespace {

std::string NameOf(const std::string& id) { return absl::StrCat("datasets/", id); }

absl::Status NoSuchDataset(const std::string& id) {
  return absl::NotFoundError(absl::StrCat("there is no ", NameOf(id)));
}

// Bounds how long the rest of a transaction waits for a server that was frozen within one.
absl::Status WaitBriefly(PostgresqlConnection& connection) {
  return connection.Run("SELECT set_config('lock_timeout', '1s', true)").status();
}

}  // namespace

PostgresqlDatasetLedger::PostgresqlDatasetLedger(Read read, Write write)
    : read_(std::move(read)), write_(std::move(write)) {}

absl::StatusOr<std::vector<v1::Dataset>> PostgresqlDatasetLedger::List(const std::string& after,
                                                                       size_t limit) {
  constexpr size_t kMost = std::numeric_limits<int32_t>::max();
  const auto rows = read_({"SELECT id, manifest FROM datasets WHERE id > $1 ORDER BY id LIMIT $2",
                           {after, static_cast<int64_t>(std::min(limit, kMost))}});
  if (!rows.ok()) return rows.status();
  std::vector<v1::Dataset> datasets;
  datasets.reserve(static_cast<size_t>(rows->count()));
  for (int row = 0; row < rows->count(); ++row) {
    const std::string name = NameOf(rows->Bytes(row, 0));
    auto dataset = ParseStoredDataset(name, rows->Bytes(row, 1));
    if (!dataset.ok()) {
      dataset = v1::Dataset();
      dataset->set_name(name);
    }
    datasets.push_back(*std::move(dataset));
  }
  return datasets;
}

absl::StatusOr<std::vector<std::string>> PostgresqlDatasetLedger::ListIds() {
  const auto rows = read_({"SELECT id FROM datasets ORDER BY id", {}});
  if (!rows.ok()) return rows.status();
  std::vector<std::string> ids;
  ids.reserve(static_cast<size_t>(rows->count()));
  for (int row = 0; row < rows->count(); ++row) ids.push_back(rows->Bytes(row, 0));
  return ids;
}

absl::StatusOr<v1::Dataset> PostgresqlDatasetLedger::Get(const std::string& id) {
  const auto rows = read_({"SELECT manifest FROM datasets WHERE id = $1", {id}});
  if (!rows.ok()) return rows.status();
  if (rows->empty()) return NoSuchDataset(id);
  return ParseStoredDataset(NameOf(id), rows->Bytes(0, 0));
}

absl::StatusOr<int64_t> PostgresqlDatasetLedger::TotalBytes() {
  const auto rows =
      read_({"SELECT least(coalesce(sum(bytes), 0), 9223372036854775807)::int8 FROM datasets"
             " WHERE bytes > 0",
             {}});
  if (!rows.ok()) return rows.status();
  return rows->Int(0, 0);
}

absl::Status PostgresqlDatasetLedger::Add(const v1::Dataset& manifest, int64_t bytes,
                                          const std::function<absl::Status()>& publish) {
  const auto id = security::ParseDatasetName(manifest.name(), "name");
  if (!id.ok()) return id.status();
  return write_([&](PostgresqlConnection& connection, SqlStatement&) {
    if (absl::Status status = WaitBriefly(connection); !status.ok()) return status;
    const auto added = connection.Run(
        "INSERT INTO datasets (id, bytes, manifest) VALUES ($1, $2, $3) ON CONFLICT DO NOTHING",
        {*id, bytes, SqlValue::Bytes(StoredDataset(manifest))});
    if (!added.ok()) return added.status();
    if (added->changed() == 0) {
      return absl::AlreadyExistsError(absl::StrCat(manifest.name(), " exists already"));
    }
    return publish();
  });
}

absl::Status PostgresqlDatasetLedger::Remove(const std::string& id,
                                             const std::function<absl::Status()>& remove) {
  return write_([&](PostgresqlConnection& connection, SqlStatement&) {
    if (absl::Status status = WaitBriefly(connection); !status.ok()) return status;
    const auto removed = connection.Run("DELETE FROM datasets WHERE id = $1", {id});
    if (!removed.ok()) return removed.status();
    return removed->changed() == 1 ? remove() : NoSuchDataset(id);
  });
}

}  // namespace maneuver::store
