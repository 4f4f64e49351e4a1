#include "server/maneuverd/health_pages.h"

#include <gtest/gtest.h>

#include <string>

namespace maneuver::health_pages_test {
namespace {

TEST(HealthPagesTest, LivenessDependsOnTheServerOnly) {
  bool alive = true;
  const auto page = LivenessPage([&alive] { return alive; });
  EXPECT_EQ(page.path, "/healthz");
  EXPECT_EQ(page.make("").status, 200);
  alive = false;
  EXPECT_EQ(page.make("").status, 503);
}

TEST(HealthPagesTest, ReadinessMeansPredictionsUnlessTheQueryNamesAService) {
  const auto page = ReadinessPage([](std::string_view service) -> std::optional<bool> {
    if (service.empty()) return true;
    if (service == "maneuver.v1.PredictionService") return false;
    return std::nullopt;
  });
  EXPECT_EQ(page.path, "/readyz");
  EXPECT_EQ(page.make("").status, 503);
  EXPECT_EQ(page.make("").text, "NOT_SERVING\n");
  EXPECT_EQ(page.make("service=maneuver.v1.PredictionService").status, 503);
  EXPECT_EQ(page.make("service=").status, 200);
  EXPECT_EQ(page.make("service=").text, "SERVING\n");
  EXPECT_EQ(page.make("service=no.such.Service").status, 404);
  EXPECT_EQ(page.make("verbose").status, 400);
}

TEST(HealthPagesTest, AServerWithoutPredictionsIsReadyAsAWhole) {
  const auto page = ReadinessPage(
      [](std::string_view service) { return std::optional(service.empty()); }, /*predicts=*/false);
  EXPECT_EQ(page.make("").status, 200);
  EXPECT_EQ(page.make("service=maneuver.v1.PredictionService").status, 503);
}

}  // namespace
}  // namespace maneuver::health_pages_test
