// Runs the command in this process, as a shell would.

#ifndef MANEUVER_TESTS_UNIT_CLIENT_RUN_MANEUVER_H_
#define MANEUVER_TESTS_UNIT_CLIENT_RUN_MANEUVER_H_

#include <sstream>
#include <string>
#include <vector>

#include "client/cli/maneuver.h"

namespace maneuver::cli {

// Exit status, standard output and standard error.
struct Result {
  int status;
  std::string out;
  std::string err;
};

// Runs `maneuver` with these arguments and this standard input.
inline Result Maneuver(const std::vector<std::string>& arguments, const std::string& input = "") {
  std::istringstream in(input);
  std::ostringstream out;
  std::ostringstream err;
  Environment environment(in, out, err);
  const int status = RunManeuver(arguments, environment);
  return {status, out.str(), err.str()};
}

}  // namespace maneuver::cli

#endif  // MANEUVER_TESTS_UNIT_CLIENT_RUN_MANEUVER_H_
