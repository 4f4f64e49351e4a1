// Writes a small model of random weights: write_small_model FOLDER [SEED].

#include <cstdlib>
#include <iostream>

#include "model/artifact/model_folder.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/model/inference/reference_model.h"

int main(int argc, char** argv) {
  if (argc < 2) {
    std::cerr << "write_small_model FOLDER [SEED]\n";
    return 2;
  }
  const auto seed = static_cast<uint32_t>(argc > 2 ? std::atoi(argv[2]) : 1);
  const auto written = maneuver::artifact::WriteModelFolder(
      argv[1], maneuver::inference::RandomModel(maneuver::artifact::TinySpec(), seed));
  if (written.ok()) return 0;
  std::cerr << written << "\n";
  return 1;
}
