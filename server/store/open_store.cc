#include "server/store/open_store.h"

#include <system_error>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "model/files/durable_file.h"
#include "server/store/postgresql_store.h"
#include "server/store/sqlite_store.h"

namespace maneuver::store {
namespace {

namespace fs = std::filesystem;

absl::StatusOr<std::unique_ptr<Store>> OpenEmbedded(const fs::path& data_dir) {
  const auto id = StoreIdOf(data_dir);
  if (!id.ok()) return id.status();
  if (!id->empty()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "the jobs and aliases of ", data_dir.string(),
        " are in PostgreSQL: name the database with --store. To start without them, which removes "
        "the checkpoints of its jobs, delete ",
        (data_dir / kStoreId).string()));
  }
  auto store = SqliteStore::Open(data_dir / kEmbeddedStore);
  if (!store.ok()) return store.status();
  return *std::move(store);
}

}  // namespace

absl::StatusOr<std::unique_ptr<Store>> OpenStore(const fs::path& data_dir,
                                                 const std::string& address, bool is_shared,
                                                 monitoring::MetricRegistry& metrics) {
  if (address.empty()) return OpenEmbedded(data_dir);
  std::error_code ignored;
  if (fs::exists(data_dir / kEmbeddedStore, ignored)) {
    return absl::FailedPreconditionError(absl::StrCat(
        (data_dir / kEmbeddedStore).string(),
        " holds jobs and aliases: bring them to the database of --store with maneuverd store copy. "
        "To start without them, which removes the checkpoints of its jobs, move the file away"));
  }
  auto store = is_shared ? PostgresqlStore::Share(address, metrics)
                         : PostgresqlStore::Open(address, metrics);
  if (!store.ok()) return store.status();
  const auto id = StoreIdOf(data_dir);
  if (!id.ok()) return id.status();
  if (id->empty()) {
    if (absl::Status status = WriteStoreId(data_dir, (*store)->id()); !status.ok()) return status;
  } else if (*id != (*store)->id()) {
    return absl::FailedPreconditionError(absl::StrCat(
        data_dir.string(), " belongs to the store ", *id, ", and the database of --store holds ",
        (*store)->id(), ": name the right database. To start with this one, which removes the ",
        "checkpoints of jobs that it does not know, delete ", (data_dir / kStoreId).string()));
  }
  return *std::move(store);
}

absl::StatusOr<std::string> StoreIdOf(const fs::path& data_dir) {
  auto text = files::ReadFile(data_dir / kStoreId);
  // Servers that start at once all write it, and some file systems of several machines lose sight
  // of a file while it is replaced.
  if (absl::IsNotFound(text.status())) text = files::ReadFile(data_dir / kStoreId);
  if (absl::IsNotFound(text.status())) return std::string();
  if (!text.ok()) return text.status();
  return std::string(absl::StripAsciiWhitespace(*text));
}

absl::Status WriteStoreId(const fs::path& data_dir, const std::string& id) {
  return files::WriteFileAtomically(data_dir / kStoreId, id + "\n");
}

}  // namespace maneuver::store
