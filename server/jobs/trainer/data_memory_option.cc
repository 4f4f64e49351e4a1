#include "server/jobs/trainer/data_memory_option.h"

namespace maneuver::trainer {

void AddDataMemoryOption(CLI::App& command, int64_t* bytes) {
  command
      .add_option("--data-memory", *bytes,
                  "Memory that recordings may take, such as 512MB or 2GB (the default); data that "
                  "do not fit are read piece by piece")
      ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
      ->check(CLI::Range(int64_t{1}, int64_t{1} << 50))
      ->type_name("SIZE");
}

}  // namespace maneuver::trainer
