#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <set>
#include <thread>
#include <vector>

#include "client/client.h"
#include "tests/unit/client/test_server.h"

namespace maneuver::client::started_predictions_test {
namespace {

std::unique_ptr<Client> ConnectTo(const TestServer& server, bool own_connection = false) {
  return *Client::Connect({.address = server.address(), .own_connection = own_connection});
}

v1::PredictRequest RequestFor(const std::string& model) {
  v1::PredictRequest request;
  request.set_model(model);
  return request;
}

// Collects answers and waits for them.
class Answers {
 public:
  OnPrediction Take() {
    return [this](absl::StatusOr<v1::PredictResponse> answer) {
      const std::lock_guard lock(mutex_);
      answers_.push_back(std::move(answer));
      changed_.notify_all();
    };
  }
  std::vector<absl::StatusOr<v1::PredictResponse>> WaitFor(size_t count) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, std::chrono::seconds(20), [&] { return answers_.size() >= count; });
    return answers_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<absl::StatusOr<v1::PredictResponse>> answers_;
};

TEST(StartPredictionTest, AnswersManyConcurrentPredictions) {
  constexpr int kCalls = 40;
  TestServer server;
  std::mutex mutex;
  std::condition_variable changed;
  int arrived = 0;
  server.on_predict = [&](auto*, const v1::PredictRequest& request, v1::PredictResponse* response) {
    // Answers nothing before all calls have arrived.
    std::unique_lock lock(mutex);
    ++arrived;
    changed.notify_all();
    changed.wait_for(lock, std::chrono::seconds(20), [&] { return arrived == kCalls; });
    response->set_model_version(request.model());
    return grpc::Status::OK;
  };
  Answers answers;
  const auto client = ConnectTo(server);
  for (int i = 0; i < kCalls / 2; ++i) {
    // The prepared prediction need not outlive the call.
    const PreparedPrediction prediction(RequestFor(std::to_string(i)));
    client->StartPrediction(prediction, answers.Take());
    client->StartPrediction(prediction, answers.Take());
  }
  std::multiset<std::string> versions;
  for (const auto& answer : answers.WaitFor(kCalls)) {
    ASSERT_TRUE(answer.ok()) << answer.status();
    versions.insert(answer->model_version());
  }
  EXPECT_EQ(versions.size(), static_cast<size_t>(kCalls));
  for (int i = 0; i < kCalls / 2; ++i) EXPECT_EQ(versions.count(std::to_string(i)), 2U);
}

TEST(StartPredictionTest, ReturnsTheServersErrorWithoutRetrying) {
  TestServer server;
  std::atomic<int> calls = 0;
  server.on_predict = [&](auto*, const auto&, auto*) {
    ++calls;
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "busy");
  };
  Answers answers;
  const auto client = ConnectTo(server);
  client->StartPrediction(PreparedPrediction(RequestFor("a")), answers.Take());
  EXPECT_EQ(answers.WaitFor(1).at(0).status(), absl::UnavailableError("busy"));
  EXPECT_EQ(calls, 1);
}

TEST(StartPredictionTest, RetriesIfTheClientAsksForIt) {
  TestServer server;
  std::atomic<int> calls = 0;
  std::atomic<size_t> least = SIZE_MAX;
  server.on_predict = [&](auto*, const v1::PredictRequest& request, v1::PredictResponse* response) {
    least = std::min<size_t>(least, request.ByteSizeLong());
    if (++calls < 3) return grpc::Status(grpc::StatusCode::UNAVAILABLE, "busy");
    response->set_model_version("models/town/versions/1");
    return grpc::Status::OK;
  };
  Answers answers;
  const auto client = *Client::Connect({.address = server.address(),
                                        .retry = {.initial_backoff = absl::Milliseconds(1)},
                                        .retry_started = true});
  // More than gRPC keeps for a retry by default.
  v1::PredictRequest large = RequestFor("a");
  constexpr size_t kLarge = 1 << 20;
  large.add_scenarios()->set_scenario_id(std::string(kLarge, 'x'));
  client->StartPrediction(PreparedPrediction(large), answers.Take());
  const auto answer = answers.WaitFor(1).at(0);
  ASSERT_TRUE(answer.ok()) << answer.status();
  EXPECT_EQ(calls, 3);
  EXPECT_GT(least, kLarge);
}

TEST(StartPredictionTest, DoesNotKeepRetryingAServerThatStaysAway) {
  constexpr int kCalls = 400;
  TestServer server;
  std::atomic<int> calls = 0;
  server.on_predict = [&](auto*, const auto&, auto*) {
    ++calls;
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "busy");
  };
  Answers answers;
  const auto client = *Client::Connect({.address = server.address(),
                                        .retry = {.initial_backoff = absl::Milliseconds(1)},
                                        .retry_started = true});
  for (int i = 1; i <= kCalls; ++i) {
    client->StartPrediction(PreparedPrediction(RequestFor("a")), answers.Take());
    EXPECT_TRUE(absl::IsUnavailable(answers.WaitFor(static_cast<size_t>(i)).back().status()));
  }
  // A hundred failures are retried; 75 of these are second or later attempts.
  EXPECT_LE(calls, kCalls + 100);
  EXPECT_GT(calls, kCalls + 50);
}

TEST(StartPredictionTest, CallsTheChosenMethod) {
  TestServer server;  // knows only Predict
  server.on_predict = [](auto*, const auto&, auto*) { return grpc::Status::OK; };
  Answers answers;
  const auto client = ConnectTo(server);
  size_t ended = 0;
  for (const auto method : {PredictionMethod::kPredictActionProbabilities,
                            PredictionMethod::kPredictActionDistributions}) {
    client->StartPrediction(PreparedPrediction(RequestFor("a"), method), answers.Take());
    EXPECT_TRUE(absl::IsUnimplemented(answers.WaitFor(++ended).back().status()));
  }
}

TEST(PreparedPredictionTest, KeepsEveryFieldThatItsMethodKnows) {
  v1::PredictRequest request = RequestFor("a");
  request.add_scenarios()->set_scenario_id("crossing");
  request.mutable_query()->set_top_k(3);
  request.set_priority(v1::PRIORITY_BULK);
  request.set_include_action_names(true);
  request.add_required_action_names("left turn");
  request.set_strict(true);

  // The fields of the three messages bear the same names.
  const std::string text = request.ShortDebugString();
  v1::PredictActionDistributionsRequest distributions;
  ASSERT_TRUE(google::protobuf::TextFormat::ParseFromString(text, &distributions));
  EXPECT_EQ(PreparedPrediction(request, PredictionMethod::kPredictActionDistributions).bytes(),
            distributions.ByteSizeLong());

  request.clear_query();
  v1::PredictActionProbabilitiesRequest probabilities;
  ASSERT_TRUE(
      google::protobuf::TextFormat::ParseFromString(request.ShortDebugString(), &probabilities));
  request.mutable_query()->set_top_k(3);
  EXPECT_EQ(PreparedPrediction(request, PredictionMethod::kPredictActionProbabilities).bytes(),
            probabilities.ByteSizeLong());
}

// Holds calls until they are cancelled.
void Hold(TestServer* server) {
  server->on_predict = [](grpc::ServerContext* context, const auto&, auto*) {
    while (!context->IsCancelled()) std::this_thread::yield();
    return grpc::Status::CANCELLED;
  };
}

TEST(StartPredictionTest, EndsAtItsDeadlineAndWhenCancelled) {
  TestServer server;
  Hold(&server);
  Answers answers;
  const auto client = ConnectTo(server);
  const PreparedPrediction prediction(RequestFor("a"));
  client->StartPrediction(prediction, answers.Take(), {.timeout = absl::Milliseconds(30)});
  EXPECT_TRUE(absl::IsDeadlineExceeded(answers.WaitFor(1).back().status()));

  Cancellation cancellation;
  client->StartPrediction(prediction, answers.Take(), {.cancellation = &cancellation});
  cancellation.Cancel();
  EXPECT_TRUE(absl::IsCancelled(answers.WaitFor(2).back().status()));
  client->StartPrediction(prediction, answers.Take(), {.cancellation = &cancellation});
  EXPECT_TRUE(absl::IsCancelled(answers.WaitFor(3).back().status()));
}

TEST(StartPredictionTest, DestroyingTheClientCancelsItsCalls) {
  TestServer server;
  Hold(&server);
  Answers answers;
  auto client = ConnectTo(server);
  for (int i = 0; i < 5; ++i) {
    client->StartPrediction(PreparedPrediction(RequestFor("a")), answers.Take());
  }
  client.reset();
  const auto ended = answers.WaitFor(0);  // all of them have ended
  ASSERT_EQ(ended.size(), 5U);
  for (const auto& answer : ended) EXPECT_TRUE(absl::IsCancelled(answer.status()));
}

TEST(ClientTest, ClientsShareAConnectionUnlessToldOtherwise) {
  TestServer server;
  std::mutex mutex;
  std::set<std::string> peers;
  server.on_predict = [&](grpc::ServerContext* context, const auto&, auto*) {
    const std::lock_guard lock(mutex);
    peers.insert(context->peer());
    return grpc::Status::OK;
  };
  std::vector<std::unique_ptr<Client>> clients;
  for (const bool own : {false, false, true, true}) {
    clients.push_back(ConnectTo(server, own));
    ASSERT_TRUE(clients.back()->Predict({}).ok());
  }
  EXPECT_EQ(peers.size(), 3U);
}

}  // namespace
}  // namespace maneuver::client::started_predictions_test
