#include "model/machine/openmp_spinning.h"

#include <cstdlib>

namespace maneuver::machine {

bool ShortenOpenMpSpinning() {
  constexpr char kVariable[] = "GOMP_SPINCOUNT";
  if (std::getenv(kVariable) != nullptr || std::getenv("OMP_WAIT_POLICY") != nullptr) return false;
  return setenv(kVariable, "10000", /*overwrite=*/0) == 0;
}

}  // namespace maneuver::machine
