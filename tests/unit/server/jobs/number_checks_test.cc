// Numbers of options that CLI11 alone would take for others.

#include "server/jobs/trainer/number_checks.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace maneuver::number_checks_test {
namespace {

TEST(NumberChecksTest, IntegersOf64BitsAreWhatTheySayAndLargerOnesAreRefused) {
  std::vector<int64_t> seeds;
  CLI::App app;
  app.add_option("--seeds", seeds)->delimiter(',')->check(FitsInt64());
  app.parse("--seeds 1,9223372036854775807,-9223372036854775808", false);
  EXPECT_EQ(seeds, (std::vector<int64_t>{1, std::numeric_limits<int64_t>::max(),
                                         std::numeric_limits<int64_t>::min()}));
  for (const std::string larger :
       {"9223372036854775808", "1,9223372036854775808", "-9223372036854775809"}) {
    EXPECT_THROW(app.parse("--seeds " + larger, false), CLI::ValidationError) << larger;
  }
}

TEST(NumberChecksTest, NotANumberIsInNoRange) {
  double seconds = 0.0;
  CLI::App app;
  app.add_option("--seconds", seconds)->check(FiniteRange(0.0, 10.0));
  app.parse("--seconds 2.5", false);
  EXPECT_EQ(seconds, 2.5);
  for (const std::string other : {"nan", "-nan", "inf", "10.1", "-0.1"}) {
    EXPECT_THROW(app.parse("--seconds=" + other, false), CLI::ValidationError) << other;
  }
}

}  // namespace
}  // namespace maneuver::number_checks_test
