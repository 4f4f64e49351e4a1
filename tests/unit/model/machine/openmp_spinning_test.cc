#include "model/machine/openmp_spinning.h"

#include <gtest/gtest.h>

#include <cstdlib>

namespace maneuver::machine {
namespace {

TEST(OpenMpSpinningTest, SetsALimitOnceAndKeepsOneThatIsThere) {
  unsetenv("GOMP_SPINCOUNT");
  unsetenv("OMP_WAIT_POLICY");
  EXPECT_TRUE(ShortenOpenMpSpinning());
  EXPECT_STREQ(std::getenv("GOMP_SPINCOUNT"), "10000");
  EXPECT_FALSE(ShortenOpenMpSpinning());

  setenv("GOMP_SPINCOUNT", "7", 1);
  EXPECT_FALSE(ShortenOpenMpSpinning());
  EXPECT_STREQ(std::getenv("GOMP_SPINCOUNT"), "7");

  unsetenv("GOMP_SPINCOUNT");
  setenv("OMP_WAIT_POLICY", "PASSIVE", 1);
  EXPECT_FALSE(ShortenOpenMpSpinning());
  EXPECT_EQ(std::getenv("GOMP_SPINCOUNT"), nullptr);
  unsetenv("OMP_WAIT_POLICY");
}

}  // namespace
}  // namespace maneuver::machine
