// Kinds of command-line options that maneuverd has many of.

#ifndef MANEUVER_SERVER_MANEUVERD_OPTION_KINDS_H_
#define MANEUVER_SERVER_MANEUVERD_OPTION_KINDS_H_

#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <functional>
#include <map>
#include <string>
#include <utility>

namespace maneuver {

enum class Least { kZero, kOne };

// Adds an option of bytes, such as 64MiB.
template <typename Bytes>
void AddBytes(CLI::App& app, const std::string& name, Bytes& bytes, const std::string& help,
              Least least = Least::kOne) {
  CLI::Option* const option = app.add_option(name, bytes, help);
  option->transform(CLI::AsSizeValue(/*kb_is_1000=*/false));
  if (least == Least::kOne) {
    option->check(CLI::PositiveNumber);
  } else {
    option->check(CLI::NonNegativeNumber);
  }
  option->capture_default_str();
}

// Adds an option whose number is kept in another unit: `set` converts it, and is called only if the
// option is given.
//   unset: what --help and --print-config show without the option; it must already be set
template <typename Number>
void AddScaled(CLI::App& app, const std::string& name, const std::string& unset,
               const CLI::Validator& range, const std::string& help,
               std::function<void(Number)> set) {
  app.add_option_function<Number>(name, std::move(set), help)->check(range)->default_str(unset);
}

// Adds an option that is one of some words, and kept as what the word stands for.
//   words: must live until the command line is parsed
//   unset: the word of the present value
template <typename Value>
void AddChoice(CLI::App& app, const std::string& name, const std::map<std::string, Value>& words,
               const std::string& unset, Value& value, const std::string& help) {
  app.add_option_function<std::string>(
         name, [&words, &value](const std::string& word) { value = words.at(word); }, help)
      ->check(CLI::IsMember(words))
      ->default_str(unset);
}

inline std::chrono::milliseconds Seconds(double seconds) {
  return std::chrono::milliseconds(std::llround(1e3 * seconds));
}

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_OPTION_KINDS_H_
