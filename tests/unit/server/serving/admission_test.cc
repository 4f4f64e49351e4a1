#include "server/serving/admission.h"

#include <gtest/gtest.h>

#include "server/errors/error_details.h"

namespace maneuver::serving::admission_test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

bool LetIn(const ExpectedWait& expected, milliseconds left) {
  return CheckTimeLeft(expected, left).ok();
}

TEST(AdmissionTest, ACallNeedsAQuarterMoreThanItsExpectedTimePlusTheTransfer) {
  const ExpectedWait expected{milliseconds(40), milliseconds(8), false};
  EXPECT_TRUE(LetIn(expected, milliseconds(63)));  // 50 + 10 + 3
  EXPECT_FALSE(LetIn(expected, milliseconds(62)));
}

TEST(AdmissionTest, AStandingQueueTriplesTheExpectedWait) {
  const ExpectedWait expected{milliseconds(40), milliseconds(8), true};
  EXPECT_TRUE(LetIn(expected, milliseconds(133)));  // 120 + 10 + 3
  EXPECT_FALSE(LetIn(expected, milliseconds(132)));
}

TEST(AdmissionTest, ARefusalSaysWhyAndWhenToRetry) {
  const absl::Status status =
      CheckTimeLeft({milliseconds(40), milliseconds(8), false}, milliseconds(13));
  EXPECT_TRUE(absl::IsResourceExhausted(status)) << status;
  EXPECT_EQ(errors::ReasonOf(status), "DEADLINE_TOO_CLOSE");
  EXPECT_EQ(errors::RetryDelay(status), milliseconds(50));
}

TEST(AdmissionTest, DelaysAreBetweenAMillisecondAndHalfAMinute) {
  EXPECT_EQ(RetryDelay(nanoseconds(5)), milliseconds(1));
  EXPECT_EQ(RetryDelay(milliseconds(20)), milliseconds(20));
  EXPECT_EQ(RetryDelay(std::chrono::hours(1)), std::chrono::seconds(30));
}

}  // namespace
}  // namespace maneuver::serving::admission_test
