#include "client/load/load_run.h"

#include <gtest/gtest.h>

#include "client/error_details.h"
#include "maneuver/v1/status.pb.h"
#include "tests/unit/client/load/simulated_server.h"

namespace maneuver::load::load_run_test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

double Milliseconds(nanoseconds time) {
  return std::chrono::duration<double, std::milli>(time).count();
}

class LoadRunTest : public ::testing::Test {
 protected:
  LoadRunTest() { plan_.duration = seconds(10); }

  void CallEvenly(double rate) { plan_.loop = OpenLoop{rate, ArrivalProcess::kConstant}; }

  Tally Run() {
    const Tally tally = RunLoad(plan_, server_, timeline_, stop_);
    EXPECT_EQ(server_.in_flight, 0);
    int64_t ended = tally.unsent + tally.unfinished;
    for (const auto& [code, count] : tally.ended) ended += count;
    EXPECT_EQ(tally.due, ended);
    return tally;
  }

  SimulatedTimeline timeline_;
  SimulatedServer server_{timeline_};
  client::Cancellation stop_;
  LoadPlan plan_;
};

TEST_F(LoadRunTest, AnOpenLoopKeepsItsRateWhenTheServerIsSlow) {
  CallEvenly(300.0);
  server_.service_time = milliseconds(10);
  const Tally tally = Run();
  EXPECT_EQ(tally.due, 3'000);
  EXPECT_DOUBLE_EQ(tally.OfferedRate(), 300.0);
  EXPECT_EQ(tally.waited, 0);
  // Answers within the window only, not those that followed it.
  EXPECT_NEAR(tally.AnsweredRate(), 100.0, 0.2);
  EXPECT_EQ(tally.Ended(absl::StatusCode::kOk), 3'000);
  for (size_t i = 0; i < server_.seen.size(); ++i) {
    EXPECT_EQ(server_.seen[i].at, TimePoint() + nanoseconds(std::llround(1e9 / 300.0 * i)));
  }
}

// A server that answers in 1 ms stalls from second 5 to second 6. Of the evenly spaced calls,
// number k of that second ends at 6 s + (k + 1) ms and takes 1001 - 9 k ms. Of all 1000 calls, 990
// take no longer than number 10, and 900 no longer than number 100.
TEST_F(LoadRunTest, AStallDelaysAllCallsDueDuringIt) {
  CallEvenly(100.0);
  server_.stalls = TimePoint() + seconds(5);
  server_.goes_on = TimePoint() + seconds(6);
  const Tally tally = Run();
  EXPECT_EQ(tally.answer_latency.count(), 1'000);
  EXPECT_NEAR(Milliseconds(tally.answer_latency.max()), 1'001.0, 1e-6);
  EXPECT_NEAR(Milliseconds(tally.answer_latency.Quantile(0.99)), 1'001.0 - 90.0, 1.0);
  EXPECT_NEAR(Milliseconds(tally.answer_latency.Quantile(0.9)), 1'001.0 - 900.0, 0.2);
  EXPECT_NEAR(Milliseconds(tally.answer_latency.Quantile(0.5)), 1.0, 0.01);
}

// The same, but the generator may have only one call in flight. It is silent during the stall and
// must not hide it.
TEST_F(LoadRunTest, LateCallsAreTimedFromWhenTheyWereDue) {
  CallEvenly(100.0);
  plan_.max_in_flight = 1;
  server_.stalls = TimePoint() + seconds(5);
  server_.goes_on = TimePoint() + seconds(6);
  const Tally tally = Run();
  EXPECT_EQ(server_.most_in_flight, 1);
  EXPECT_EQ(tally.unsent, 0);
  // Those due between 5 s and 6 s, and some more until they had all been answered.
  EXPECT_GE(tally.waited, 99);
  EXPECT_LE(tally.waited, 120);
  EXPECT_NEAR(Milliseconds(tally.answer_latency.Quantile(0.99)), 1'001.0 - 90.0, 1.0);
  EXPECT_GT(tally.lateness.max(), milliseconds(900));
}

TEST_F(LoadRunTest, CountsCallsThatWereNeverSent) {
  CallEvenly(100.0);
  plan_.max_in_flight = 5;
  server_.service_time = seconds(4);
  plan_.patience = seconds(60);
  const Tally tally = Run();
  EXPECT_EQ(tally.due, 1'000);
  EXPECT_EQ(server_.seen.size(), 5U + 2U);  // five at once, and one after each of two answers
  EXPECT_EQ(tally.unsent, 1'000 - 7);
}

TEST_F(LoadRunTest, DoesNotMeasureCallsDueInTheWarmUp) {
  CallEvenly(100.0);
  plan_.warm_up = seconds(2);
  server_.answer = [](int n) {
    return n < 200 ? absl::UnavailableError("starting") : absl::OkStatus();
  };
  const Tally tally = Run();
  EXPECT_EQ(server_.seen.size(), 1'200U);
  EXPECT_EQ(tally.due, 1'000);
  EXPECT_EQ(tally.Failed(), 0);
  EXPECT_TRUE(tally.failure.ok());
  EXPECT_EQ(tally.length, seconds(10));
}

TEST_F(LoadRunTest, TellsThatAllCallsFellIntoTheWarmUp) {
  plan_.warm_up = seconds(2);
  plan_.calls = 50;
  for (const bool open : {true, false}) {
    if (open) {
      CallEvenly(100.0);
    } else {
      plan_.loop = ClosedLoop{4};
    }
    const Tally tally = Run();
    EXPECT_EQ(tally.due, 0);
    EXPECT_TRUE(tally.only_warm_up);
  }
  plan_.calls = 5'000;  // the server answers 1,000 a second
  EXPECT_FALSE(Run().only_warm_up);
  plan_.calls.reset();
  EXPECT_FALSE(Run().only_warm_up);
}

TEST_F(LoadRunTest, AClosedLoopKeepsItsCallersBusy) {
  plan_.loop = ClosedLoop{4};
  server_.service_time = milliseconds(5);
  const Tally tally = Run();
  EXPECT_EQ(server_.most_in_flight, 4);
  EXPECT_NEAR(tally.AnsweredRate(), 200.0, 0.5);
  EXPECT_EQ(tally.answer_latency.Quantile(0.5), tally.answer_latency.max());
  EXPECT_EQ(tally.answer_latency.max(), milliseconds(20));  // three before it
}

TEST_F(LoadRunTest, ARefusedCallerWaitsForTheRetryDelay) {
  plan_.loop = ClosedLoop{1};
  plan_.duration = seconds(1);
  server_.answer = [](int) {
    v1::RetryInfo info;
    info.mutable_retry_delay()->set_nanos(200'000'000);
    v1::Status status;
    status.set_code(static_cast<int>(absl::StatusCode::kResourceExhausted));
    status.add_details()->set_type_url("type.googleapis.com/google.rpc.RetryInfo");
    status.mutable_details(0)->set_value(info.SerializeAsString());
    return client::ToStatus(status);
  };
  Run();
  ASSERT_GE(server_.seen.size(), 4U);
  for (size_t i = 1; i < server_.seen.size(); ++i) {
    EXPECT_GE(server_.seen[i].at - server_.seen[i - 1].at, milliseconds(201));
    EXPECT_LE(server_.seen[i].at - server_.seen[i - 1].at, milliseconds(251));
  }
}

TEST_F(LoadRunTest, CallersOfAnUnreachableServerDoNotSpin) {
  plan_.loop = ClosedLoop{10};
  plan_.duration = seconds(1);
  server_.service_time = nanoseconds(0);
  server_.answer = [](int) { return absl::UnavailableError("gone"); };
  const Tally tally = Run();
  EXPECT_LE(server_.seen.size(), 10U * 100U);
  EXPECT_EQ(tally.failure.message(), "gone");
}

TEST_F(LoadRunTest, DeadlinesAreDrawnFromTheirRangeAndCountFromTheDueTime) {
  CallEvenly(100.0);
  plan_.deadline = DeadlineRange{1.0, 5.0};
  server_.service_time = nanoseconds(0);
  Run();
  nanoseconds least = seconds(1);
  nanoseconds most{0};
  for (const auto& call : server_.seen) {
    least = std::min(least, call.timeout);
    most = std::max(most, call.timeout);
  }
  EXPECT_GE(Milliseconds(least), 1.0);
  EXPECT_LE(Milliseconds(least), 1.1);
  EXPECT_GE(Milliseconds(most), 4.9);
  EXPECT_LE(Milliseconds(most), 5.0);
}

TEST_F(LoadRunTest, ALateCallHasLessTimeLeft) {
  CallEvenly(100.0);
  plan_.max_in_flight = 1;
  plan_.deadline = DeadlineRange{500.0, 500.0};
  server_.stalls = TimePoint() + seconds(5);
  server_.goes_on = TimePoint() + seconds(6);
  const Tally tally = Run();
  EXPECT_GT(tally.Ended(absl::StatusCode::kDeadlineExceeded), 0);
  // No call that was due in the first half of the stall was answered after its end.
  EXPECT_LE(tally.answer_latency.max(), milliseconds(500));
  EXPECT_TRUE(tally.failure.ok());
}

TEST_F(LoadRunTest, EndsAfterTheNumberOfCalls) {
  plan_.calls = 50;
  CallEvenly(100.0);
  EXPECT_EQ(Run().due, 50);
  EXPECT_LE(timeline_.elapsed(), milliseconds(700));

  plan_.loop = ClosedLoop{8};
  server_.seen.clear();
  const Tally tally = Run();
  EXPECT_EQ(tally.due, 50);
  EXPECT_EQ(tally.length, milliseconds(50));  // one millisecond each
}

TEST_F(LoadRunTest, StoppingEndsItAtOnceAndKeepsItsResults) {
  for (const bool open : {true, false}) {
    SimulatedTimeline timeline;
    SimulatedServer server(timeline);
    server.service_time = milliseconds(100);
    server.stalls = TimePoint() + seconds(2);
    client::Cancellation stop;
    timeline.At(TimePoint() + seconds(3), [&] { stop.Cancel(); });
    if (open) {
      CallEvenly(10.0);
    } else {
      plan_.loop = ClosedLoop{3};
    }
    const Tally tally = RunLoad(plan_, server, timeline, stop);
    EXPECT_EQ(server.cancellations, 1);
    EXPECT_EQ(server.in_flight, 0);
    EXPECT_EQ(tally.length, seconds(3));
    EXPECT_EQ(tally.Ended(absl::StatusCode::kOk), 20);
    EXPECT_EQ(tally.unfinished, open ? 10 : 3);
    EXPECT_EQ(tally.Failed(), 0);
  }
}

TEST_F(LoadRunTest, DoesNotWaitForeverForAnAnswer) {
  CallEvenly(10.0);
  server_.stalls = TimePoint() + seconds(5);
  plan_.patience = seconds(2);
  const Tally tally = Run();
  EXPECT_EQ(tally.Ended(absl::StatusCode::kDeadlineExceeded) + tally.unfinished, 50);
  EXPECT_LE(timeline_.elapsed(), seconds(14));
}

}  // namespace
}  // namespace maneuver::load::load_run_test
