// Checks of numbers that are given as options.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_NUMBER_CHECKS_H_
#define MANEUVER_SERVER_JOBS_TRAINER_NUMBER_CHECKS_H_

#include <CLI/CLI.hpp>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <string>

namespace maneuver {

// Accepts numbers from `least` to `most`. CLI::Range accepts "nan" as well.
inline CLI::Validator FiniteRange(double least, double most) {
  const CLI::Range range(least, most);
  return CLI::Validator(
      [range](std::string& text) {
        std::string error = range(text);
        double number = 0.0;
        if (error.empty() && CLI::detail::lexical_cast(text, number) && std::isnan(number)) {
          error = "Value " + text + " is not a number";
        }
        return error;
      },
      range.get_description());
}

// Accepts integers of 64 bits. CLI11 itself takes the largest one in place of a larger one.
inline CLI::Validator FitsInt64() {
  return CLI::Validator(
      [](std::string& text) -> std::string {
        errno = 0;
        (void)std::strtoll(text.c_str(), nullptr, 0);  // as CLI11 reads it
        return errno == ERANGE ? "Value " + text + " is out of range" : "";
      },
      "");
}

}  // namespace maneuver

#endif  // MANEUVER_SERVER_JOBS_TRAINER_NUMBER_CHECKS_H_
