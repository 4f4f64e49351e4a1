#ifndef MANEUVER_SERVER_JOBS_TRAINER_DATA_MEMORY_OPTION_H_
#define MANEUVER_SERVER_JOBS_TRAINER_DATA_MEMORY_OPTION_H_

#include <CLI/CLI.hpp>
#include <cstdint>

namespace maneuver::trainer {

// Adds --data-memory, the memory that recordings may take, to a command. Sizes are written as 512MB
// or 2GB.
//   bytes: the default; set when the command line is parsed
void AddDataMemoryOption(CLI::App& command, int64_t* bytes);

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_DATA_MEMORY_OPTION_H_
