// Reads options from the environment and from a file, besides the command line. Names correspond:
// --max-batch, MANEUVERD_MAX_BATCH, and in the file max-batch. The command line overrides the
// environment, which overrides the file.

#ifndef MANEUVER_SERVER_MANEUVERD_CONFIGURATION_H_
#define MANEUVER_SERVER_MANEUVERD_CONFIGURATION_H_

#include <CLI/CLI.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace maneuver {

// An option whose value is not from the command line.
struct Setting {
  std::string name;    // "max-batch"
  std::string value;   // as on the command line; empty counts as unset
  std::string source;  // as errors name it: "MANEUVERD_MAX_BATCH", "maneuverd.conf:3"
};

// Parses a file of settings, with lines such as
//   max-batch = 32          # a comment
//   log-format = "json"
// A value with spaces, quotes or # must be in quotes, where \" \\ and \n stand for a quote, a
// backslash and the end of a line. INVALID_ARGUMENT, with file and line, for any other line and for
// a name that appears twice.
absl::StatusOr<std::vector<Setting>> ParseSettings(std::string_view text, const std::string& file);

// Returns every option of a program with its value, in the form of ParseSettings. Call after the
// program's arguments are parsed.
std::string PrintSettings(const CLI::App& app);

// What a program is started with.
class Configuration {
 public:
  // Reads the environment, and the file that --config or MANEUVERD_CONFIG names.
  //   app: its configurable() options may appear in both.
  //   arguments: the command line, without the program's name.
  //   environment: ends with nullptr, as environ does.
  // INVALID_ARGUMENT for unknown names in either, NOT_FOUND for a file that cannot be read.
  static absl::StatusOr<Configuration> Read(const CLI::App& app, std::vector<std::string> arguments,
                                            const char* const* environment);

  // Returns everything as one command line.
  std::vector<std::string> CommandLine() const;

  // Returns `error`, which names an option, with the source of that option's value before it.
  std::string WithSource(const std::string& error) const;

 private:
  std::vector<std::string> arguments_;
  std::vector<Setting> settings_;  // that the command line does not override
};

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_CONFIGURATION_H_
