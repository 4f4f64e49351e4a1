// Commands of the command line and their arguments. A narrow interface to CLI11, whose templates
// are compiled only in command.cc.

#ifndef MANEUVER_CLIENT_CLI_COMMAND_H_
#define MANEUVER_CLIENT_CLI_COMMAND_H_

#include <cstdint>
#include <functional>
#include <iosfwd>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/cli/command_entry.h"

namespace CLI {
class App;
}

namespace maneuver::cli {

enum ExitCode : int {
  kOk = 0,             // all done
  kFailed = 1,         // the call failed, or part of what was asked for did
  kUsage = 2,          // the command line, or a file that it names, makes no sense
  kInterrupted = 130,  // Ctrl-C stopped watching a job that continues; as shells say it
};

// A command, or a group of commands. Variables that are passed by pointer hold the default and must
// outlive the parsing. `flags` has the form "-o,--output".
class Command {
 public:
  // Wraps `app`.
  //   chosen: receives the function of the command that the user named.
  Command(CLI::App* app, std::function<int()>* chosen) : app_(app), chosen_(chosen) {}

  // Adds a subcommand. The user must then name one of the subcommands.
  //   help: what it does, and an example.
  Command Add(const std::string& name, const std::string& summary, const std::string& help = "");

  // Add positional arguments. `name` appears in capitals in the help.
  void Argument(const std::string& name, std::string* value, const std::string& help);
  void Argument(const std::string& name, int64_t* value, int64_t least, int64_t most,
                const std::string& help);
  void OptionalArgument(const std::string& name, std::string* value, const std::string& help);
  void Arguments(const std::string& name, std::vector<std::string>* values,
                 const std::string& help);
  void OptionalArguments(const std::string& name, std::vector<std::string>* values,
                         const std::string& help);

  void Option(const std::string& flags, std::string* value, const std::string& help,
              const std::string& environment = "");
  void Option(const std::string& flags, std::optional<std::string>* value, const std::string& help);
  // Numbers outside the range are usage errors.
  void Option(const std::string& flags, int64_t* value, int64_t least, int64_t most,
              const std::string& help);
  void Option(const std::string& flags, std::optional<int64_t>* value, int64_t least, int64_t most,
              const std::string& help);
  void Option(const std::string& flags, double* value, double least, double most,
              const std::string& help);
  void Option(const std::string& flags, std::optional<double>* value, double least, double most,
              const std::string& help);
  // An option that may be repeated, with one value each time.
  void Option(const std::string& flags, std::vector<std::string>* values, const std::string& help,
              bool required = false);
  // An option with several numbers, separated by commas. It may be repeated.
  void Option(const std::string& flags, std::vector<int64_t>* values, int64_t least, int64_t most,
              const std::string& help);
  void Choice(const std::string& flags, std::string* value, const std::vector<std::string>& choices,
              const std::string& help);
  // An option that may be repeated; each value is one of `choices`.
  void Choices(const std::string& flags, std::vector<std::string>* values,
               const std::vector<std::string>& choices, const std::string& help);
  // An option that names a PNG file to write. A name with the extension of another kind of file is
  // a usage error.
  void Picture(const std::string& flags, std::optional<std::string>* value,
               const std::string& help);
  void Flag(const std::string& flags, bool* value, const std::string& help);
  // Forbids that both options are given.
  void Exclude(const std::string& flag, const std::string& other);
  // Forbids that the first option is given without the second.
  void Need(const std::string& flag, const std::string& other);

  // Sets what the command does. `run` returns its ExitCode.
  void Run(std::function<int()> run);

 private:
  CLI::App* app_;
  std::function<int()>* chosen_;
};

// The command line as a whole.
class CommandLine {
 public:
  CommandLine(const std::string& summary, const std::string& name, const std::string& version);
  ~CommandLine();

  Command root();
  // Sets a function that runs after the options are read and before the command.
  void BeforeCommand(std::function<void()> prepare) { prepare_ = std::move(prepare); }
  // Says that another program has this command. An error about the unknown word names it.
  //   program: such as "maneuverd"
  void NameElsewhere(const std::string& command, const std::string& program) {
    elsewhere_[command] = program;
  }
  // Returns all commands and their options.
  CommandEntry Describe() const;
  // Parses the arguments (without the program's name) and runs the command that they name. Returns
  // its ExitCode. Help and version go to `out`, usage errors to `err`. `help COMMAND` does what
  // `COMMAND --help` does.
  int Run(std::vector<std::string> arguments, std::ostream& out, std::ostream& err);

 private:
  std::unique_ptr<CLI::App> app_;
  std::function<int()> chosen_;
  std::function<void()> prepare_;
  std::map<std::string, std::string> elsewhere_;  // program by command
};

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_COMMAND_H_
