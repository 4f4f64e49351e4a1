#include "server/serving/memory_budget.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "server/errors/error_details.h"
#include "server/monitoring/prometheus_metrics.h"
#include "server/serving/send_memory.h"

namespace maneuver::serving::memory_budget_test {
namespace {

class MemoryBudgetTest : public testing::Test {
 protected:
  const std::unique_ptr<monitoring::PrometheusMetrics> metrics_ =
      monitoring::PrometheusMetrics::Create();
  int64_t used_ = 0;
  int64_t unused_ = 0;  // of these
  int freed_ = 0;
  MemoryBudget budget_{1000, [this] { return used_; },
                       [this] {
                         used_ -= unused_;
                         unused_ = 0;
                         ++freed_;
                       },
                       *metrics_};
};

TEST_F(MemoryBudgetTest, RefusesCallsAboveFourFifthsOfTheLimitAndAdmitsThemBelow) {
  used_ = 800;
  budget_.Look();
  EXPECT_TRUE(budget_.Admit().ok());
  used_ = 801;
  budget_.Look();
  const absl::Status refused = budget_.Admit();
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(errors::ReasonOf(refused), "MEMORY_FULL");
  EXPECT_TRUE(errors::RetryDelay(refused).has_value());
  used_ = 500;
  budget_.Look();
  EXPECT_TRUE(budget_.Admit().ok());
}

TEST_F(MemoryBudgetTest, FreesUnusedMemoryBeforeItRefuses) {
  used_ = 900;
  unused_ = 300;
  budget_.Look();
  EXPECT_EQ(freed_, 1);
  EXPECT_TRUE(budget_.Admit().ok());
}

TEST_F(MemoryBudgetTest, FreesAtMostOnceASecond) {
  used_ = 900;
  for (int i = 0; i < 3; ++i) budget_.Look();
  EXPECT_EQ(freed_, 1);
}

TEST_F(MemoryBudgetTest, RefusesAnswersTooWhichIncludesThoseOfStreams) {
  SendMemory answers({}, *metrics_, &budget_);
  EXPECT_TRUE(answers.Reserve(10, 1).ok());
  used_ = 900;
  budget_.Look();
  EXPECT_EQ(errors::ReasonOf(answers.Reserve(10, 1).status()), "MEMORY_FULL");
}

TEST(MemoryLimitTest, WithoutALimitNothingIsRefused) {
  MemoryBudget budget(0, monitoring::MetricRegistry::Null());
  budget.Look();
  EXPECT_TRUE(budget.Admit().ok());
  EXPECT_EQ(ShareOf(0, 4, 1000), 1000);
}

TEST(MemoryLimitTest, BuffersGetTheirPartOfALimitOrLess) {
  EXPECT_EQ(ShareOf(1600, 16, 1000), 100);
  EXPECT_EQ(ShareOf(1600, 16, 50), 50);
}

// Any process takes more than a byte.
TEST(MemoryLimitTest, SeesTheMemoryOfThisProcess) {
  MemoryBudget budget(1, monitoring::MetricRegistry::Null());
  budget.Look();
  EXPECT_FALSE(budget.Admit().ok());
}

}  // namespace
}  // namespace maneuver::serving::memory_budget_test
