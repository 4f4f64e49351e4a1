#include "server/maneuverd/repair_command.h"

#include <iostream>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "server/maneuverd/data_lock.h"
#include "server/maneuverd/options.h"
#include "server/store/store_repair.h"

namespace maneuver {
namespace {

constexpr int kRepairFailed = 1;
constexpr int kWrongRepairUsage = 2;

constexpr char kRepairUsage[] =
    R"(maneuverd repair: brings a damaged maneuver.db back, while no server uses it

Usage: maneuverd repair --data-dir DIR [--backup BACKUP] [OPTIONS]

Jobs and aliases that can still be read stay as they are. All others are taken from BACKUP, a folder
that deploy/backup.sh made; without it they are lost. The damaged file is kept beside the new one. A
sound database is left alone. Models and datasets are never touched.

OPTIONS are those of the server, such as --config FILE; its environment variables count too.
)";

std::string Describe(const store::StoreRepair& repair, bool has_backup) {
  if (repair.damage.empty()) {
    return absl::StrCat("the store is sound, and nothing was changed: ",
                        repair.contents.ToString());
  }
  std::string text =
      absl::StrCat("repaired: ", repair.damage, "\nthe store has ", repair.contents.ToString(),
                   "\n", repair.readable_jobs, " jobs and ", repair.readable_aliases,
                   " aliases could be read in the damaged one",
                   has_backup ? "; all others are as they were backed up" : "",
                   "\nthe damaged one is kept: ", repair.damaged_file.string());
  if (!repair.dropped_aliases.empty()) {
    absl::StrAppend(&text, "\nremoved, because their versions are gone: ",
                    absl::StrJoin(repair.dropped_aliases, ", "));
  }
  return text;
}

absl::StatusOr<std::string> Repair(const ServerOptions& options, const std::string& backup) {
  if (!options.store.empty()) {
    return absl::InvalidArgumentError(
        "jobs and aliases are in the database of --store: restore that with PostgreSQL's means");
  }
  if (options.data_dir.empty()) return absl::InvalidArgumentError("--data-dir is required");
  const auto lock = DataLock::Take(options.data_dir);
  if (!lock.ok()) return lock.status();
  const auto repair = store::RepairStore(options.data_dir, backup);
  if (!repair.ok()) return repair.status();
  return Describe(*repair, !backup.empty());
}

}  // namespace

int RunRepairCommand(int argc, const char* const* argv, const char* const* environment) {
  std::string backup;
  std::vector<const char*> server_line = {"maneuverd"};
  for (int i = 1; i < argc; ++i) {
    const std::string_view argument = argv[i];
    if (argument == "--help" || argument == "-h") {
      std::cout << kRepairUsage;
      return 0;
    }
    if (argument == "--backup" && i + 1 < argc) {
      backup = argv[++i];
    } else if (argument.starts_with("--backup=")) {
      backup = argument.substr(argument.find('=') + 1);
    } else {
      server_line.push_back(argv[i]);
    }
  }
  const auto parsed = ParseCommandLine(static_cast<int>(server_line.size()), server_line.data(),
                                       environment, /*needs_data_dir=*/false);
  if (const int* status = std::get_if<int>(&parsed)) return *status;
  const auto done = Repair(std::get<ServerOptions>(parsed), backup);
  if (done.ok()) {
    std::cout << *done << std::endl;
    return 0;
  }
  std::cerr << "maneuverd repair: " << done.status().message() << "\n";
  return absl::IsInvalidArgument(done.status()) ? kWrongRepairUsage : kRepairFailed;
}

}  // namespace maneuver
