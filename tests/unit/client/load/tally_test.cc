#include "client/load/tally.h"

#include <gtest/gtest.h>

#include "client/error_details.h"

namespace maneuver::load::tally_test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr TimePoint kStart{seconds(100)};
constexpr Window kWindow{kStart, kStart + seconds(10)};

// Returns a refusal as the server sends it.
absl::Status Refused(int64_t delay_milliseconds) {
  v1::RetryInfo info;
  info.mutable_retry_delay()->set_nanos(static_cast<int32_t>(delay_milliseconds * 1'000'000));
  v1::Status status;
  status.set_code(static_cast<int>(absl::StatusCode::kResourceExhausted));
  status.set_message("too much");
  auto& detail = *status.add_details();
  detail.set_type_url("type.googleapis.com/google.rpc.RetryInfo");
  detail.set_value(info.SerializeAsString());
  return client::ToStatus(status);
}

TEST(TallyTest, LatencyCountsFromWhenACallWasDue) {
  Tally tally;
  tally.Add(kWindow, kStart + seconds(1), kStart + seconds(3), kStart + seconds(4),
            {absl::OkStatus(), 2});
  EXPECT_EQ(tally.answer_latency.max(), seconds(3));
  EXPECT_EQ(tally.lateness.max(), seconds(2));
  EXPECT_EQ(tally.answered_targets, 2);
}

TEST(TallyTest, CallsCountByDueTimeAndAnswersByArrivalTime) {
  Tally tally;
  tally.length = seconds(10);
  const auto answered = [&](seconds due, seconds ended) {
    tally.Add(kWindow, kStart + due, kStart + due, kStart + ended, {absl::OkStatus(), 3});
  };
  answered(seconds(-1), seconds(1));  // due in the warm-up
  answered(seconds(2), seconds(3));
  answered(seconds(9), seconds(12));   // too late to be goodput
  answered(seconds(10), seconds(11));  // the window is half open
  EXPECT_EQ(tally.due, 2);
  EXPECT_EQ(tally.Ended(absl::StatusCode::kOk), 2);
  EXPECT_EQ(tally.answer_latency.count(), 2);
  EXPECT_EQ(tally.answered_calls, 2);
  EXPECT_DOUBLE_EQ(tally.AnsweredTargetRate(), 0.6);
  EXPECT_DOUBLE_EQ(tally.OfferedRate(), 0.2);
}

TEST(TallyTest, CountsRefusalsAndTheirRetryDelays) {
  Tally tally;
  const auto refused = [&](const absl::Status& status) {
    tally.Add(kWindow, kStart, kStart, kStart + milliseconds(2), {status});
  };
  refused(Refused(700));
  refused(Refused(30));
  refused(absl::ResourceExhaustedError("says nothing of when"));
  EXPECT_EQ(tally.Ended(absl::StatusCode::kResourceExhausted), 3);
  EXPECT_EQ(tally.refused_with_delay, 2);
  EXPECT_EQ(tally.least_delay, milliseconds(30));
  EXPECT_EQ(tally.most_delay, milliseconds(700));
  EXPECT_EQ(tally.refusal_latency.count(), 3);
  EXPECT_EQ(tally.answer_latency.count(), 0);
  EXPECT_TRUE(tally.failure.ok());
  EXPECT_EQ(tally.Failed(), 0);
}

TEST(TallyTest, CountsCallsHeldBackByTheClientSeparately) {
  Tally tally;
  const auto refused = [&](const std::string& reason) {
    tally.Add(kWindow, kStart, kStart, kStart,
              {client::WithDetails(absl::ResourceExhaustedError("too much"),
                                   {.reason = reason, .retry_delay = absl::Milliseconds(5)})});
  };
  refused("QUEUE_FULL");
  refused(client::kHeldBack);
  refused(client::kHeldBack);
  EXPECT_EQ(tally.held_back, 2);
  EXPECT_EQ(tally.refused_with_delay, 3);
  EXPECT_EQ(tally.Ended(absl::StatusCode::kResourceExhausted), 3);
}

TEST(TallyTest, KeepsTheFirstFailureThatLoadDoesNotExplain) {
  Tally tally;
  for (const absl::Status& status :
       {absl::DeadlineExceededError("late"), absl::NotFoundError("no such model"),
        absl::UnavailableError("gone")}) {
    tally.Add(kWindow, kStart, kStart, kStart, {status});
  }
  EXPECT_EQ(tally.Failed(), 2);
  EXPECT_EQ(tally.failure.message(), "no such model");
}

TEST(TallyTest, TargetsRefusedWithinAnAnswerAreAFailure) {
  Tally tally;
  tally.Add(kWindow, kStart, kStart, kStart, {absl::OkStatus(), 1, 2, "target_ids[1] is nobody"});
  EXPECT_EQ(tally.refused_targets, 2);
  EXPECT_EQ(tally.answered_targets, 1);
  EXPECT_EQ(tally.failure.message(), "target_ids[1] is nobody");
}

}  // namespace
}  // namespace maneuver::load::tally_test
