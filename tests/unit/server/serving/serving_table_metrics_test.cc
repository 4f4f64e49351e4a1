// What the page of metrics says of the serving table.

#include "server/serving/serving_table_metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "server/monitoring/prometheus_metrics.h"
#include "tests/unit/server/serving/serving_table_fixture.h"

namespace maneuver::serving::serving_table_metrics_test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class ServingTableMetricsTest : public ServingTableTest {
 protected:
  ServingTableMetricsTest() { UseMetrics(*metrics_); }

  std::string Page() const { return metrics_->Page(); }
  static std::string Of(const std::string& alias, int version) {
    return "\nmaneuver_model_version{alias=\"" + alias + "\",model=\"town\"} " +
           std::to_string(version) + "\n";
  }
  static std::string Swaps(const std::string& alias, int count) {
    return "\nmaneuver_model_swaps_total{alias=\"" + alias + "\"} " + std::to_string(count) + "\n";
  }

  const std::unique_ptr<monitoring::PrometheusMetrics> metrics_ =
      monitoring::PrometheusMetrics::Create();
};

TEST_F(ServingTableMetricsTest, ShowsTheVersionOfAnAliasUntilItIsDeleted) {
  EXPECT_THAT(Page(), HasSubstr("\nmaneuver_serving_models 0\n"));
  ASSERT_TRUE(Publish("town").ok());
  EXPECT_THAT(Page(), HasSubstr("\nmaneuver_serving_models 1\n"));
  EXPECT_THAT(Page(), HasSubstr(Of("serving", 1)));
  EXPECT_THAT(Page(), HasSubstr(Of("candidate", 0)));
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(table_->SetAlias({"town", "candidate"}, 2).ok());
  EXPECT_THAT(Page(), HasSubstr(Of("candidate", 2)));
  ASSERT_TRUE(table_->DeleteAlias({"town", "candidate"}).ok());
  EXPECT_THAT(Page(), HasSubstr(Of("candidate", 0)));
  ASSERT_TRUE(table_->DeleteAlias({"town", "serving"}).ok());
  EXPECT_THAT(Page(), HasSubstr(Of("serving", 0)));
  EXPECT_THAT(Page(), HasSubstr("\nmaneuver_serving_models 0\n"));
}

TEST_F(ServingTableMetricsTest, CountsASwapWhenAnAliasMoves) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("town").ok());
  EXPECT_THAT(Page(), HasSubstr(Swaps("serving", 1)));
  ASSERT_TRUE(table_->SetAlias({"town", "serving"}, 2).ok());
  ASSERT_TRUE(table_->SetAlias({"town", "serving"}, 2).ok());  // it does already
  EXPECT_THAT(Page(), HasSubstr(Swaps("serving", 2)));
  EXPECT_THAT(Page(), HasSubstr(Swaps("candidate", 0)));
  // Names of aliases are callers': they are not labels.
  ASSERT_TRUE(table_->SetAlias({"town", "friday"}, 1).ok());
  EXPECT_THAT(Page(), HasSubstr(Swaps("other", 1)));
  EXPECT_THAT(Page(), Not(HasSubstr("friday")));
}

TEST_F(ServingTableMetricsTest, CountsAVersionThatCannotBeLoaded) {
  ASSERT_TRUE(Publish("town").ok());
  std::ofstream(folder_ / "models/town/1/weights.safetensors") << "altered";
  Restart();
  EXPECT_THAT(Page(), HasSubstr("\nmaneuver_model_load_failures_total 1\n"));
  EXPECT_THAT(Page(), HasSubstr("\nmaneuver_serving_models 0\n"));
}

TEST(ServingTableMetricsLimitTest, HasLabelsForAtMost32Models) {
  const auto page = monitoring::PrometheusMetrics::Create();
  ServingTableMetrics metrics(*page, /*serves=*/true);
  std::map<security::ModelAliasName, int> aliases;
  for (int i = 0; i < 40; ++i) aliases[{"model" + std::to_string(i), "serving"}] = 1;
  metrics.Show(aliases);
  const std::string text = page->Page();
  int series = 0;
  for (size_t at = 0; (at = text.find("\nmaneuver_model_version{", at)) != std::string::npos;
       ++at) {
    ++series;
  }
  EXPECT_EQ(series, 2 * 32);
  EXPECT_THAT(text, HasSubstr("\nmaneuver_serving_models 40\n"));
}

TEST(ServingTableMetricsWithoutServingTest, HasNoNumberOfModelsThatServe) {
  const auto page = monitoring::PrometheusMetrics::Create();
  ServingTableMetrics metrics(*page, /*serves=*/false);
  metrics.Show({});
  EXPECT_THAT(page->Page(), testing::Not(HasSubstr("maneuver_serving_models")));
}

}  // namespace
}  // namespace maneuver::serving::serving_table_metrics_test
