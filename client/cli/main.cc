#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

#include "client/cli/maneuver.h"

int main(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);
  maneuver::cli::Environment environment(std::cin, std::cout, std::cerr);
  if (const char* token = std::getenv("MANEUVER_TOKEN")) environment.token = token;
  const char* no_color = std::getenv("NO_COLOR");
  environment.color =
      isatty(STDOUT_FILENO) == 1 && (no_color == nullptr || std::string(no_color).empty());
  environment.interactive = isatty(STDERR_FILENO) == 1;
  return maneuver::cli::RunManeuver(std::vector<std::string>(argv + 1, argv + argc), environment);
}
