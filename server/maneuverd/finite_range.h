// A range of numbers with fractions, as a check of an option.

#ifndef MANEUVER_SERVER_MANEUVERD_FINITE_RANGE_H_
#define MANEUVER_SERVER_MANEUVERD_FINITE_RANGE_H_

#include <CLI/CLI.hpp>
#include <cmath>
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

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_FINITE_RANGE_H_
