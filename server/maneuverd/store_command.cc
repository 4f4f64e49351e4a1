#include "server/maneuverd/store_command.h"

#include <iostream>
#include <memory>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "server/maneuverd/data_lock.h"
#include "server/maneuverd/options.h"
#include "server/store/open_store.h"
#include "server/store/store_check.h"
#include "server/store/store_copy.h"
#include "server/store/store_migration.h"

namespace maneuver {
namespace {

constexpr int kFailed = 1;
constexpr int kWrongUsage = 2;

constexpr char kUsage[] =
    R"(maneuverd store: the database of jobs and aliases

Usage: maneuverd store COMMAND [OPTIONS]

  migrate   Makes the tables in the database of --store, or brings those of an earlier release up to
            date. Without --store: those of the data folder. Servers that share the store may run
            meanwhile, unless it says that they have to stop
  check     Reads every job, event, alias and manifest of a dataset, compares them with their
            checksums, and counts them
  copy      Copies jobs and aliases of the data folder into the empty database of --store, to which
            the folder then belongs; maneuver.db stays as maneuver.db.copied

For check and copy, and for a store that is not shared, stop the servers first.
OPTIONS are those of the server, such as --config FILE, --data-dir DIR and --store URI; its
environment variables count too.
)";

absl::StatusOr<std::string> Migrate(const ServerOptions& options) {
  if (options.store.empty()) {
    const auto store = store::OpenStore(options.data_dir, "");
    if (!store.ok()) return store.status();
    return std::string("the store of the data folder is up to date");
  }
  const auto migration = store::MigrateStore(options.store);
  if (!migration.ok()) return migration.status();
  const auto [from, to] = *migration;
  if (from == to) return absl::StrCat("the store has schema version ", to, " already");
  if (from == 0) return absl::StrCat("made a store with schema version ", to);
  return absl::StrCat("brought the store from schema version ", from, " to ", to);
}

absl::StatusOr<std::string> Check(const ServerOptions& options) {
  const auto store = store::OpenStore(options.data_dir, options.store);
  if (!store.ok()) return store.status();
  const auto contents = store::CheckStore(**store);
  if (!contents.ok()) return contents.status();
  return absl::StrCat("the store is sound: ", contents->ToString());
}

absl::StatusOr<std::string> Copy(const ServerOptions& options) {
  if (options.store.empty()) {
    return absl::InvalidArgumentError("--store is missing: name the database to copy into");
  }
  const auto copied = store::CopyStore(options.data_dir, options.store);
  if (!copied.ok()) return copied.status();
  return absl::StrCat("copied ", copied->ToString(), "; ", options.data_dir.string(),
                      " belongs to the database of --store now, and the old store is ",
                      (options.data_dir / store::kCopiedStore).string());
}

absl::StatusOr<std::string> Run(const std::string& command, const ServerOptions& options) {
  // Of the tables alone: there may be no data folder yet.
  if (command == "migrate" && !options.store.empty()) return Migrate(options);
  const auto lock = DataLock::Take(options.data_dir);
  if (!lock.ok()) return lock.status();
  if (command == "migrate") return Migrate(options);
  return command == "check" ? Check(options) : Copy(options);
}

}  // namespace

int RunStoreCommand(int argc, const char* const* argv, const char* const* environment) {
  const std::string command = argc > 1 ? argv[1] : "";
  if (command == "--help" || command == "-h") {
    std::cout << kUsage;
    return 0;
  }
  if (command != "migrate" && command != "check" && command != "copy") {
    std::cerr << kUsage;
    return kWrongUsage;
  }
  std::vector<const char*> server_line = {"maneuverd"};
  server_line.insert(server_line.end(), argv + 2, argv + argc);
  const auto parsed = ParseCommandLine(static_cast<int>(server_line.size()), server_line.data(),
                                       environment, /*needs_data_dir=*/false);
  if (const int* status = std::get_if<int>(&parsed)) return *status;
  const auto& options = std::get<ServerOptions>(parsed);
  absl::StatusOr<std::string> done = absl::InvalidArgumentError("--data-dir is required");
  const bool needs_data_dir = command != "migrate" || options.store.empty();
  if (!needs_data_dir || !options.data_dir.empty()) done = Run(command, options);
  if (done.ok()) {
    std::cout << *done << std::endl;
    return 0;
  }
  std::cerr << "maneuverd store " << command << ": " << done.status().message() << "\n";
  return absl::IsInvalidArgument(done.status()) ? kWrongUsage : kFailed;
}

}  // namespace maneuver
