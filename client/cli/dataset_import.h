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

// One recording that was found on disk.
struct RawRecording {
  // Makes the scenario. Called once, on any thread.
  std::function<absl::StatusOr<v1::Scenario>()> parse;
  std::string place;  // for messages: "a.tfrecord at offset 12"
  double end = 0.0;   // offset in its ImportFile where it ends, bytes
};

// A file that a format reads as a whole.
struct ImportFile {
  std::filesystem::path path;
  double bytes = 0.0;  // for the progress
};

// Receives what a format reads. Not thread-safe.
class ImportSink {
 public:
  virtual ~ImportSink() = default;
  // Takes a recording. Blocks while enough others are being parsed. If the result is an error,
  // reading ends with it.
  virtual absl::Status Take(RawRecording&& recording) = 0;
  // Counts and reports damage. If it returns OK, the format leaves out the damaged part and reads
  // on. Otherwise it returns `damage`, and reading ends with that.
  virtual absl::Status Damaged(const absl::Status& damage) = 0;
  // Tells the user something that is not a fault.
  virtual void Note(const std::string& text) = 0;
  // Shows that this many bytes of the present ImportFile have been read.
  virtual void ShowProgress(double bytes) = 0;
};

struct ImportFormat {
  std::string name;  // for messages: "Waymo scenario"
  // Returns the files that the inputs of the command name, in the order in which they are read.
  std::function<absl::StatusOr<std::vector<ImportFile>>(const std::vector<std::string>& inputs)>
      find;
  // Reads one of them, recording by recording.
  std::function<absl::Status(const std::filesystem::path& file, ImportSink& sink)> read;
};

// Returns the files that `inputs` name. Of a folder these are the files with this extension, such
// as ".xml", by name; without one, all but hidden files. NOT_FOUND if there are none.
absl::StatusOr<std::vector<ImportFile>> FindFiles(const std::vector<std::string>& inputs,
                                                  const std::string& extension);

// Adds the arguments and options to a command. `what` says in its help which files it reads.
void AddImportOptions(Command& command, ImportArguments& arguments, const std::string& what);

// Reads one recording after the other, and parses `threads` of them at once (by default one for
// each core). Holds at most a few recordings for each thread in memory. Writes the dataset in the
// order of the files. Prints what was left out; the exit status is then kFailed.
int RunImport(const ImportArguments& arguments, const ImportFormat& format,
              Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_DATASET_IMPORT_H_
