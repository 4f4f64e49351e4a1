// Parses the ranges and rates that `maneuver load` takes.

#ifndef MANEUVER_CLIENT_CLI_LOAD_ARGUMENTS_H_
#define MANEUVER_CLIENT_CLI_LOAD_ARGUMENTS_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace maneuver::cli {

struct NumberRange {
  double least = 0.0;
  double most = 0.0;
};

// Parses "5" or "1-5", with bounds within [`least`, `most`]. INVALID_ARGUMENT names `flag` for
// anything else.
absl::StatusOr<NumberRange> ParseRange(const std::string& flag, const std::string& text,
                                       double least, double most);

// Does the same as ParseRange for whole numbers.
absl::StatusOr<NumberRange> ParseWholeRange(const std::string& flag, const std::string& text,
                                            int least, int most);

// One step of a sweep: calls per second, or a share of the server's capacity.
struct SweepRate {
  double value = 0.0;  // > 0; 0.25 is 25 %
  bool of_capacity = false;
};

// Parses a list such as "25%,100%,200". INVALID_ARGUMENT for anything else.
absl::StatusOr<std::vector<SweepRate>> ParseRates(const std::string& text);

// Returns the name of a rate: "25 %" or "200/s".
std::string RateName(const SweepRate& rate);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_LOAD_ARGUMENTS_H_
