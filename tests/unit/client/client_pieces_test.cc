#include <gtest/gtest.h>

#include "absl/time/clock.h"
#include "client/error_details.h"
#include "client/observed_scenario.h"
#include "client/retry.h"

namespace maneuver::client::client_pieces_test {
namespace {

TEST(BackoffTest, DoublesUpToItsLimit) {
  RetryPolicy policy;
  policy.initial_backoff = absl::Milliseconds(100);
  policy.max_backoff = absl::Milliseconds(300);
  policy.jitter = 0.0;
  EXPECT_EQ(BackoffAfter(policy, 1, 0.7), absl::Milliseconds(100));
  EXPECT_EQ(BackoffAfter(policy, 2, 0.7), absl::Milliseconds(200));
  EXPECT_EQ(BackoffAfter(policy, 3, 0.7), absl::Milliseconds(300));
  EXPECT_EQ(BackoffAfter(policy, 60, 0.7), absl::Milliseconds(300));
}

TEST(BackoffTest, JitterShortensAndLengthensEqually) {
  RetryPolicy policy;
  policy.initial_backoff = absl::Milliseconds(100);
  policy.jitter = 0.2;
  EXPECT_EQ(BackoffAfter(policy, 1, 0.0), absl::Milliseconds(80));
  EXPECT_EQ(BackoffAfter(policy, 1, 0.5), absl::Milliseconds(100));
  EXPECT_LT(BackoffAfter(policy, 1, 0.999), absl::Milliseconds(120));
}

TEST(RetryTest, DoesNotWaitPastTheDeadline) {
  RetryPolicy policy;
  policy.initial_backoff = absl::Hours(1);
  policy.max_backoff = absl::Hours(1);
  int attempts = 0;
  const absl::Status status =
      RetryUnavailable(policy, absl::Now() + absl::Minutes(1), nullptr, nullptr, [&] {
        ++attempts;
        return absl::UnavailableError("busy");
      });
  EXPECT_TRUE(absl::IsUnavailable(status));
  EXPECT_EQ(attempts, 1);
}

TEST(RetryTest, TheServersRetryDelayLengthensTheWait) {
  v1::Status busy;
  busy.set_code(14);
  v1::RetryInfo info;
  info.mutable_retry_delay()->set_nanos(3'000'000);
  busy.add_details()->set_type_url("type.googleapis.com/google.rpc.RetryInfo");
  busy.mutable_details(0)->set_value(info.SerializeAsString());
  RetryPolicy policy;
  policy.max_attempts = 2;
  policy.initial_backoff = absl::Microseconds(1);
  absl::Duration waited;
  const auto note = [&](const absl::Status&, absl::Duration wait) { waited = wait; };
  (void)RetryUnavailable(policy, absl::InfiniteFuture(), nullptr, note,
                         [&] { return ToStatus(busy); });
  EXPECT_EQ(waited, absl::Milliseconds(3));
}

TEST(RetryTest, CancellationEndsAWait) {
  Cancellation cancellation;
  RetryPolicy policy;
  policy.initial_backoff = absl::Hours(1);
  policy.max_backoff = absl::Hours(1);
  const auto cancel = [&](const absl::Status&, absl::Duration) { cancellation.Cancel(); };
  EXPECT_TRUE(
      absl::IsCancelled(RetryUnavailable(policy, absl::InfiniteFuture(), &cancellation, cancel,
                                         [] { return absl::UnavailableError("busy"); })));
}

// google.rpc.Status {code 3, message "bad", details: BadRequest, RetryInfo 1.5 s}, in bytes, as the
// standard messages define them.
std::string StandardDetails() {
  const auto field = [](char tag, const std::string& value) {
    return std::string{tag, static_cast<char>(value.size())} + value;
  };
  const std::string violation =
      field(0x0a, "scenarios[2].agents[0].length") + field(0x12, "must be > 0");
  const std::string bad_request = field(0x0a, violation);
  const std::string duration("\x08\x01\x10\x80\xca\xb5\xee\x01", 8);  // 1 s, 500,000,000 ns
  const std::string retry = field(0x0a, duration);
  const std::string info = field(0x0a, "BAD_SCENE") + field(0x12, "maneuver") +
                           field(0x1a, field(0x0a, "index") + field(0x12, "2"));
  const auto any = [&](const std::string& type, const std::string& value) {
    return field(0x1a, field(0x0a, "type.googleapis.com/google.rpc." + type) + field(0x12, value));
  };
  return std::string("\x08\x03", 2) + field(0x12, "bad") + any("BadRequest", bad_request) +
         any("RetryInfo", retry) + any("ErrorInfo", info) + any("Unheard", "\xff\xff");
}

TEST(ErrorDetailsTest, ReadsTheStandardMessages) {
  const absl::Status status = StatusFromWire(3, "bad", StandardDetails());
  EXPECT_TRUE(absl::IsInvalidArgument(status));
  const ErrorDetails details = ErrorDetailsOf(status);
  EXPECT_EQ(details.reason, "BAD_SCENE");
  EXPECT_EQ(details.metadata.at("index"), "2");
  ASSERT_EQ(details.field_violations.size(), 1U);
  EXPECT_EQ(details.field_violations[0].field, "scenarios[2].agents[0].length");
  EXPECT_EQ(details.field_violations[0].description, "must be > 0");
  EXPECT_EQ(details.retry_delay, absl::Milliseconds(1500));
}

TEST(ErrorDetailsTest, ListsTheActionNamesThatAreGone) {
  const absl::Status status = WithDetails(absl::FailedPreconditionError("gone"),
                                          {.reason = "ACTION_NAME_GONE",
                                           .metadata = {{"model_version", "models/town/versions/2"},
                                                        {"action_name_1", "brake hard"},
                                                        {"action_name_0", "left turn, tight"}}});
  EXPECT_EQ(ErrorDetailsOf(status).missing_action_names,
            (std::vector<std::string>{"left turn, tight", "brake hard"}));
  EXPECT_TRUE(ErrorDetailsOf(absl::NotFoundError("no such model")).missing_action_names.empty());
}

TEST(ErrorDetailsTest, AnItemsErrorHasTheSameDetails) {
  v1::Status item;
  ASSERT_TRUE(item.ParseFromString(StandardDetails()));
  EXPECT_EQ(ErrorDetailsOf(item).reason, "BAD_SCENE");
  EXPECT_EQ(ErrorDetailsOf(ToStatus(item)).field_violations.size(), 1U);
}

TEST(ErrorDetailsTest, DamagedDetailsDoNotHideTheError) {
  const absl::Status status = StatusFromWire(5, "no such model", "\xff\xff\xff");
  EXPECT_TRUE(absl::IsNotFound(status));
  EXPECT_EQ(status.message(), "no such model");
  EXPECT_EQ(ErrorDetailsOf(status).reason, "");
}

v1::Scenario RecordedScenario() {
  v1::Scenario scenario;
  scenario.set_prediction_time(1.0);
  for (const int64_t id : {1, 2, 3}) {
    v1::Agent* agent = scenario.add_agents();
    agent->set_id(id);
    for (const double time : {0.9, 1.0, 1.1}) {
      if (id > 1 && time < 1.05) continue;  // 2 and 3 appear later
      agent->add_states()->set_time(time);
    }
  }
  scenario.add_target_ids(1);
  scenario.add_target_ids(3);
  scenario.add_traffic_signals()->add_readings()->set_time(0.5);
  scenario.mutable_traffic_signals(0)->add_readings()->set_time(1.5);
  scenario.add_map_features()->add_x(4.0);
  return scenario;
}

TEST(StripFutureTest, KeepsStatesUpToThePredictionTime) {
  v1::Scenario scenario = RecordedScenario();
  StripFuture(&scenario);
  ASSERT_EQ(scenario.agents_size(), 2);  // 2 has not appeared yet; 3 is a target
  EXPECT_EQ(scenario.agents(0).id(), 1);
  ASSERT_EQ(scenario.agents(0).states_size(), 2);
  EXPECT_EQ(scenario.agents(0).states(1).time(), 1.0);
  EXPECT_EQ(scenario.agents(1).id(), 3);
  EXPECT_EQ(scenario.agents(1).states_size(), 0);
  EXPECT_EQ(scenario.traffic_signals(0).readings_size(), 1);
  EXPECT_EQ(scenario.map_features_size(), 1);
}

}  // namespace
}  // namespace maneuver::client::client_pieces_test
