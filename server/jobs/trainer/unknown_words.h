// Names the word of a command line that a program does not know.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_UNKNOWN_WORDS_H_
#define MANEUVER_SERVER_JOBS_TRAINER_UNKNOWN_WORDS_H_

#include <CLI/CLI.hpp>
#include <string>

namespace maneuver {

// Returns "there is no option --dataste", or "there is no command trian"; empty if the program
// knows all words. To be called after parsing has failed: CLI11 would rather say what is missing.
inline std::string UnknownWord(const CLI::App& app) {
  for (const std::string& word : app.remaining(/*recurse=*/true)) {
    if (word == "--") continue;
    if (word.starts_with("-")) return "there is no option " + word.substr(0, word.find('='));
    if (app.get_subcommands().empty()) return "there is no command " + word;
  }
  return "";
}

}  // namespace maneuver

#endif  // MANEUVER_SERVER_JOBS_TRAINER_UNKNOWN_WORDS_H_
