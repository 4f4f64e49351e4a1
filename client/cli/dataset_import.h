// Imports recordings of other formats into a dataset folder: what all formats have in common.

#ifndef MANEUVER_CLIENT_CLI_DATASET_IMPORT_H_
#define MANEUVER_CLIENT_CLI_DATASET_IMPORT_H_

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/command.h"
#include "client/cli/environment.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::cli {

// The options that every format has.
struct ImportArguments {
  std::string folder;
  std::vector<std::string> inputs;
  std::string on_damage = "stop";  // or skip
  bool strict = false;
  std::string origin;
  std::optional<int64_t> threads;
};

// One recording as it is stored on disk.
struct RawRecording {
  std::string bytes;
  std::string place;  // for messages: "a.tfrecord at offset 12"
  double end = 0.0;   // offset of its end within its file, bytes
};

struct ImportFormat {
  std::string name;  // for messages: "Waymo scenario"
  // Reads a file, recording by recording, until `take` returns an error or the file ends. Calls
  // `damaged` for a damaged recording, which counts and reports it; if that returns true the
  // recording is skipped, otherwise the result is DATA_LOSS.
  std::function<absl::Status(const std::filesystem::path& file,
                             const std::function<absl::Status(RawRecording&&)>& take,
                             const std::function<bool(const absl::Status&)>& damaged)>
      read;
  // Called from several threads.
  std::function<absl::StatusOr<v1::Scenario>(std::string_view bytes)> parse;
  // The extension of the files of a folder to read, such as ".xml"; empty: all files but hidden
  // ones.
  std::string extension;
};

// Adds the arguments and options to a command.
void AddImportOptions(Command& command, ImportArguments& arguments, const std::string& what);

// Reads one recording after the other, and parses and checks them on all cores. Memory is limited
// to a few recordings for each core. Writes the dataset in the order of the files. Prints what was
// left out; the exit status is then kFailed.
int RunImport(const ImportArguments& arguments, const ImportFormat& format,
              Environment& environment);

// The formats.
void AddImportWaymo(Command& import, Environment& environment);
void AddImportCommonRoad(Command& import, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_DATASET_IMPORT_H_
