// Describes the commands as data, from which shell completion and manual pages are made.

#ifndef MANEUVER_CLIENT_CLI_COMMAND_ENTRY_H_
#define MANEUVER_CLIENT_CLI_COMMAND_ENTRY_H_

#include <string>
#include <vector>

namespace maneuver::cli {

struct OptionEntry {
  std::vector<std::string> flags;  // "-v", "--verbose"
  bool takes_value = false;
  std::vector<std::string> choices;  // of the value; empty: anything
  std::string help;
};

struct CommandEntry {
  std::string path;     // "maneuver dataset upload"
  std::string summary;  // one line
  std::vector<OptionEntry> options;
  std::vector<CommandEntry> commands;  // below this one

  std::string name() const { return path.substr(path.rfind(' ') + 1); }
};

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_COMMAND_ENTRY_H_
