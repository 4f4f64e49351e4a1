// Commands of the command line, and what they take. A narrow face on CLI11, whose templates are
// compiled by command.cc alone.

#ifndef MANEUVER_CLIENT_CLI_COMMAND_H_
#define MANEUVER_CLIENT_CLI_COMMAND_H_

#include <cstdint>
#include <functional>
#include <iosfwd>
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
  kOk = 0,      // all done
  kFailed = 1,  // the call failed, or part of what was asked for did
  kUsage = 2,   // the command line, or a file that it names, makes no sense
};

// A command, or a group of them. Variables handed over by pointer hold the default and outlive the
// parsing. `flags` are as in "-o,--output".
class Command {
 public:
  //   chosen: receives what the command that was named does.
  Command(CLI::App* app, std::function<int()>* chosen) : app_(app), chosen_(chosen) {}

  // A command below this one; one of them must then be given.
  //   help: what it does, and an example.
  Command Add(const std::string& name, const std::string& summary, const std::string& help = "");

  // Positional arguments; `name` is in capitals in the help.
  void Argument(const std::string& name, std::string* value, const std::string& help);
  void Argument(const std::string& name, int64_t* value, int64_t least, int64_t most,
                const std::string& help);
  void OptionalArgument(const std::string& name, std::string* value, const std::string& help);
  void Arguments(const std::string& name, std::vector<std::string>* values,
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
  // May be given many times, and take several values each time.
  void Option(const std::string& flags, std::vector<std::string>* values, const std::string& help,
              bool required = false);
  // May be given many times, with one value each time.
  void OptionPerValue(const std::string& flags, std::vector<std::string>* values,
                      const std::string& help);
  // Several numbers, separated by commas or spaces.
  void Option(const std::string& flags, std::vector<int64_t>* values, const std::string& help);
  void Choice(const std::string& flags, std::string* value, const std::vector<std::string>& choices,
              const std::string& help);
  // May be given many times.
  void Choices(const std::string& flags, std::vector<std::string>* values,
               const std::vector<std::string>& choices, const std::string& help);
  // A PNG file to write; names that end as those of other kinds of files are usage errors.
  void Picture(const std::string& flags, std::optional<std::string>* value,
               const std::string& help);
  void Flag(const std::string& flags, bool* value, const std::string& help);
  // These two options cannot be given together.
  void Exclude(const std::string& flag, const std::string& other);
  // The first option cannot be given without the second.
  void Need(const std::string& flag, const std::string& other);

  // What the command does; returns its ExitCode.
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
  // Called once the options are read, before the command that they are for.
  void BeforeCommand(std::function<void()> prepare) { prepare_ = std::move(prepare); }
  // All commands and their options.
  CommandEntry Describe() const;
  // Parses the arguments (without the program's name) and runs the command that they name. Help and
  // version go to `out`, usage errors to `err`. `help COMMAND` does what `COMMAND --help` does.
  int Run(std::vector<std::string> arguments, std::ostream& out, std::ostream& err);

 private:
  std::unique_ptr<CLI::App> app_;
  std::function<int()> chosen_;
  std::function<void()> prepare_;
};

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_COMMAND_H_
