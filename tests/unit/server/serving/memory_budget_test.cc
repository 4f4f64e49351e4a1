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
  budget_.Relieve();
  EXPECT_TRUE(budget_.Admit().ok());
  used_ = 801;
  budget_.Relieve();
  const absl::Status refused = budget_.Admit();
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(errors::ReasonOf(refused), "MEMORY_FULL");
  EXPECT_TRUE(errors::RetryDelay(refused).has_value());
  used_ = 500;
  budget_.Relieve();
  EXPECT_TRUE(budget_.Admit().ok());
}

TEST_F(MemoryBudgetTest, FreesUnusedMemoryBeforeItRefuses) {
  used_ = 900;
  unused_ = 300;
  budget_.Relieve();
  EXPECT_EQ(freed_, 1);
  EXPECT_TRUE(budget_.Admit().ok());
}

TEST_F(MemoryBudgetTest, FreesAtMostOnceASecond) {
  used_ = 900;
  for (int i = 0; i < 3; ++i) budget_.Relieve();
  EXPECT_EQ(freed_, 1);
}

TEST_F(MemoryBudgetTest, TellsAtEachLookHowMuchIsInUseAndCountsClosedConnections) {
  std::vector<double> parts;
  budget_.RelieveBy([&parts](double part) {
    parts.push_back(part);
    return part > 0.9 ? 3 : 0;
  });
  for (const int64_t used : {500, 900, 901}) {
    used_ = used;
    budget_.Relieve();
  }
  EXPECT_THAT(parts, testing::ElementsAre(0.5, 0.9, 0.901));
  EXPECT_THAT(metrics_->Page(), testing::HasSubstr("maneuver_memory_closed_connections_total 3\n"));
}

constexpr int64_t kLarge = 100'000;  // bytes of a request

// Parsed, a request takes several times its size; until then nobody sees that.
TEST(MemoryLimitTest, LargeRequestsThatAreParsedAtOnceMustFitTogether) {
  int64_t used = 0;
  int freed = 0;
  MemoryBudget budget(
      20 * kLarge, [&used] { return used; }, [&freed] { ++freed; },
      monitoring::MetricRegistry::Null());
  auto first = budget.AdmitRequest(kLarge);
  ASSERT_TRUE(first.ok()) << first.status();
  auto second = budget.AdmitRequest(kLarge);
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_EQ(errors::ReasonOf(budget.AdmitRequest(kLarge).status()), "MEMORY_FULL");
  EXPECT_TRUE(budget.AdmitRequest(1000).ok()) << "small ones pass";
  // Perhaps what is used was freed and can be given back.
  budget.Relieve();
  EXPECT_EQ(freed, 1);
  *first = nullptr;
  EXPECT_TRUE(budget.AdmitRequest(kLarge).ok());
  *second = nullptr;
  used = 10 * kLarge;
  EXPECT_EQ(errors::ReasonOf(budget.AdmitRequest(kLarge).status()), "MEMORY_FULL");
}

TEST_F(MemoryBudgetTest, RefusesAnswersTooWhichIncludesThoseOfStreams) {
  SendMemory answers({}, *metrics_, &budget_);
  EXPECT_TRUE(answers.Reserve(10, 1).ok());
  used_ = 900;
  budget_.Relieve();
  EXPECT_EQ(errors::ReasonOf(answers.Reserve(10, 1).status()), "MEMORY_FULL");
}

TEST(MemoryLimitTest, WithoutALimitNothingIsRefused) {
  MemoryBudget budget(0, monitoring::MetricRegistry::Null());
  budget.Relieve();
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
  budget.Relieve();
  EXPECT_FALSE(budget.Admit().ok());
}

}  // namespace
}  // namespace maneuver::serving::memory_budget_test
