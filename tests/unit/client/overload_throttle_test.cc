#include "client/overload_throttle.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <future>

#include "client/client.h"
#include "client/error_details.h"
#include "tests/unit/client/test_server.h"

namespace maneuver::client::overload_throttle_test {
namespace {

constexpr absl::Duration kTimeout = absl::Milliseconds(500);

absl::Status Refusal() {
  return WithDetails(absl::ResourceExhaustedError("too much to do"),
                     {.reason = "QUEUE_FULL", .retry_delay = absl::Milliseconds(70)});
}

// A server that accepts a number of calls per second and refuses the others, and a client that
// makes `rate` calls per second, evenly.
struct Simulation {
  OverloadThrottle throttle{7};
  absl::Time now = absl::UnixEpoch();
  double allowance = 0.0;  // calls that the server can accept now, at most 10
  int sent = 0;
  int accepted = 0;

  void Run(absl::Duration time, double rate, double capacity, absl::Duration timeout = kTimeout) {
    sent = accepted = 0;
    const auto calls = static_cast<int>(absl::ToDoubleSeconds(time) * rate);
    for (int i = 0; i < calls; ++i, now += absl::Seconds(1) / rate) {
      allowance = std::min(10.0, allowance + capacity / rate);
      if (!throttle.Admit(timeout, now).ok()) continue;
      ++sent;
      const bool accepts = allowance >= 1.0;
      if (accepts) allowance -= 1.0, ++accepted;
      throttle.Record(accepts ? absl::OkStatus() : Refusal(), timeout, now);
    }
  }
};

TEST(OverloadThrottleTest, HoldsNothingBackFromAServerThatAcceptsFiveSixths) {
  Simulation simulation;
  simulation.Run(absl::Seconds(20), 100, 84);
  EXPECT_EQ(simulation.sent, 2000);
}

TEST(OverloadThrottleTest, SendsAnOverloadedServerLittleMoreThanItAccepts) {
  Simulation simulation;
  simulation.Run(absl::Seconds(20), 3000, 1000);  // until it settles
  simulation.Run(absl::Seconds(20), 3000, 1000);
  EXPECT_NEAR(simulation.accepted, 20000, 200);
  EXPECT_NEAR(simulation.sent, OverloadThrottle::kSentOfAccepted * 20000, 600);
}

TEST(OverloadThrottleTest, SendsEverythingAgainSoonAfterTheServerRecovers) {
  Simulation simulation;
  simulation.Run(absl::Seconds(20), 300, 30);
  EXPECT_LT(simulation.sent, 0.25 * 20 * 300);
  simulation.Run(absl::Seconds(20), 300, 1000);
  simulation.Run(absl::Seconds(1), 300, 1000);
  EXPECT_EQ(simulation.sent, 300);
}

TEST(OverloadThrottleTest, StillAsksAServerThatAcceptsNothing) {
  Simulation simulation;
  simulation.Run(absl::Seconds(20), 100, 0);
  EXPECT_GT(simulation.sent, 10);
  EXPECT_LT(simulation.sent, 200);
}

TEST(OverloadThrottleTest, NeverHoldsBackOccasionalCallers) {
  Simulation simulation;
  simulation.Run(absl::Seconds(60), 1, 0);
  EXPECT_EQ(simulation.sent, 60);
}

TEST(OverloadThrottleTest, RefusedShortDeadlinesDoNotHoldBackLongerOnes) {
  Simulation simulation;
  simulation.Run(absl::Seconds(5), 500, 0, absl::Milliseconds(5));
  EXPECT_LT(simulation.sent, 500);
  EXPECT_TRUE(simulation.throttle.Admit(kTimeout, simulation.now).ok());
  simulation.Run(absl::Seconds(1), 500, 500, kTimeout);
  EXPECT_EQ(simulation.sent, 500);
}

TEST(OverloadThrottleTest, TimeoutsHoldBackLikeRefusals) {
  OverloadThrottle throttle(1);
  int sent = 0;
  for (int i = 0; i < 1000; ++i) {
    const absl::Status status = throttle.Admit(kTimeout, absl::UnixEpoch());
    if (status.ok()) {
      ++sent;
      throttle.Record(absl::DeadlineExceededError("late"), kTimeout, absl::UnixEpoch());
    } else {
      EXPECT_EQ(ErrorDetailsOf(status).retry_delay, OverloadThrottle::kDelay);
    }
  }
  EXPECT_LT(sent, 50);
}

TEST(OverloadThrottleTest, OtherOutcomesDoNotHoldBack) {
  for (const absl::Status& status :
       {absl::OkStatus(), absl::UnavailableError("away"), absl::CancelledError("enough"),
        absl::InvalidArgumentError("wrong"),
        absl::ResourceExhaustedError("the message is too large")}) {
    OverloadThrottle throttle;
    for (int i = 0; i < 1000; ++i) {
      ASSERT_TRUE(throttle.Admit(kTimeout, absl::UnixEpoch()).ok()) << status;
      throttle.Record(status, kTimeout, absl::UnixEpoch());
    }
  }
}

TEST(OverloadThrottleTest, HeldBackCallsGetTheServersLatestRetryDelay) {
  OverloadThrottle throttle(1);
  absl::Status status;
  for (int i = 0; i < 1000 && status.ok(); ++i) {
    status = throttle.Admit(kTimeout, absl::UnixEpoch());
    if (status.ok()) throttle.Record(Refusal(), kTimeout, absl::UnixEpoch());
  }
  EXPECT_TRUE(absl::IsResourceExhausted(status)) << status;
  EXPECT_EQ(ErrorDetailsOf(status).reason, kHeldBack);
  EXPECT_EQ(ErrorDetailsOf(status).retry_delay, absl::Milliseconds(70));
}

// Returns how many of 200 calls reach a server that refuses all.
int CallsThatReach(bool hold_back, bool started) {
  TestServer server;
  std::atomic<int> reached = 0;
  server.on_predict = [&](auto*, const v1::PredictRequest&, auto*) {
    ++reached;
    v1::RetryInfo retry;
    retry.mutable_retry_delay()->set_nanos(1'000'000);
    v1::Status status;
    auto& detail = *status.add_details();
    detail.set_type_url("type.googleapis.com/google.rpc.RetryInfo");
    detail.set_value(retry.SerializeAsString());
    return grpc::Status(grpc::StatusCode::RESOURCE_EXHAUSTED, "busy", status.SerializeAsString());
  };
  auto client = *Client::Connect({.address = server.address(), .hold_back = hold_back});
  for (int i = 0; i < 200; ++i) {
    if (!started) {
      EXPECT_TRUE(absl::IsResourceExhausted(client->Predict({}).status()));
      continue;
    }
    std::promise<absl::Status> end;
    client->StartPrediction(PreparedPrediction({}),
                            [&end](const auto& answer) { end.set_value(answer.status()); });
    EXPECT_TRUE(absl::IsResourceExhausted(end.get_future().get()));
  }
  return reached;
}

TEST(OverloadThrottleTest, AClientHoldsBackBothKindsOfPredictionsUnlessTurnedOff) {
  for (const bool started : {false, true}) {
    EXPECT_LT(CallsThatReach(true, started), 40) << started;
    EXPECT_EQ(CallsThatReach(false, started), 200) << started;
  }
}

}  // namespace
}  // namespace maneuver::client::overload_throttle_test
