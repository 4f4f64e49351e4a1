#include "server/serving/send_memory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <utility>

#include "server/errors/error_details.h"
#include "server/monitoring/prometheus_metrics.h"

namespace maneuver::serving::send_memory_test {
namespace {

using testing::HasSubstr;

class SendMemoryTest : public testing::Test {
 protected:
  const std::unique_ptr<monitoring::PrometheusMetrics> metrics_ =
      monitoring::PrometheusMetrics::Create();
  SendMemory memory_{{.max_response_bytes = 1000, .max_send_memory = 2500}, *metrics_};
};

TEST_F(SendMemoryTest, RefusesAnAnswerThatIsTooLargeAndSaysHowManyTargetsFit) {
  const auto share = memory_.Reserve(1200, 6);
  EXPECT_EQ(share.status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(errors::ReasonOf(share.status()), "RESPONSE_TOO_LARGE");
  EXPECT_THAT(std::string(share.status().message()), HasSubstr("at most 5 targets"));
  EXPECT_FALSE(errors::RetryDelay(share.status()).has_value());
  EXPECT_TRUE(memory_.Reserve(1000, 6).ok());
}

TEST_F(SendMemoryTest, RefusesWhileUnreadAnswersFillIt) {
  auto first = memory_.Reserve(1000, 1);
  auto second = memory_.Reserve(1000, 1);
  ASSERT_TRUE(first.ok() && second.ok());
  const auto refused = memory_.Reserve(501, 1);
  EXPECT_EQ(errors::ReasonOf(refused.status()), "SEND_MEMORY_FULL");
  EXPECT_TRUE(errors::RetryDelay(refused.status()).has_value());
  { const SendMemory::Share taken = *std::move(first); }
  EXPECT_TRUE(memory_.Reserve(501, 1).ok());
}

TEST_F(SendMemoryTest, ReleasesWhatAnAnswerDidNotNeed) {
  auto share = memory_.Reserve(1000, 1);
  ASSERT_TRUE(share.ok());
  share->ShrinkTo(300);
  EXPECT_EQ(share->bytes(), 300);
  share->ShrinkTo(700);  // it never takes more
  EXPECT_EQ(share->bytes(), 300);
  EXPECT_THAT(metrics_->Page(), HasSubstr("\nmaneuver_send_memory_bytes 300\n"));
  { const SendMemory::Share taken = *std::move(share); }
  EXPECT_THAT(metrics_->Page(), HasSubstr("\nmaneuver_send_memory_bytes 0\n"));
}

TEST_F(SendMemoryTest, RefusesAnAnswerThatIsThereAndDoesNotFit) {
  const auto large = memory_.TakeIfRoom(1001);
  EXPECT_EQ(errors::ReasonOf(large.status()), "RESPONSE_TOO_LARGE");
  EXPECT_THAT(std::string(large.status().message()), HasSubstr("page_size"));
  const SendMemory::Share unread = memory_.Take(2000);
  EXPECT_TRUE(memory_.TakeIfRoom(500).ok());
  EXPECT_EQ(errors::ReasonOf(memory_.TakeIfRoom(501).status()), "SEND_MEMORY_FULL");
  const SendMemory::Share more = memory_.Take(1000);
  EXPECT_TRUE(memory_.TakeIfRoom(0).ok());  // such as that of a deletion
}

TEST_F(SendMemoryTest, CountsAnAnswerThatIsThereAboveTheLimitAndHasNoRoomUntilItIsRead) {
  EXPECT_TRUE(memory_.CheckRoom().ok());
  {
    const SendMemory::Share unread = memory_.Take(4000);
    EXPECT_THAT(metrics_->Page(), HasSubstr("\nmaneuver_send_memory_bytes 4000\n"));
    const absl::Status full = memory_.CheckRoom();
    EXPECT_EQ(errors::ReasonOf(full), "SEND_MEMORY_FULL");
    EXPECT_TRUE(errors::RetryDelay(full).has_value());
    EXPECT_FALSE(memory_.Reserve(1, 1).ok());
  }
  EXPECT_TRUE(memory_.CheckRoom().ok());
  EXPECT_THAT(metrics_->Page(), HasSubstr("\nmaneuver_send_memory_bytes 0\n"));
}

}  // namespace
}  // namespace maneuver::serving::send_memory_test
