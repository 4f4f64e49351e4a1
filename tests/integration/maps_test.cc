// Tests registered maps with a real server and the C++ client: answers are the same, also after the
// server has lost a map.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <future>
#include <memory>

#include "client/client.h"
#include "client/error_details.h"
#include "client/map_reuse.h"
#include "client/observed_scenario.h"
#include "model/data/tfrecord.h"
#include "model/data/waymo/waymo_reader.h"
#include "tests/integration/trained_server.h"

namespace maneuver::integration::maps_test {
namespace {

class MapsTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { trained_ = std::make_unique<TrainedServer>(); }
  static void TearDownTestSuite() { trained_.reset(); }

  static std::unique_ptr<client::Client> Connect(const ServerProcess& server) {
    return *client::Client::Connect({.address = server.address()});
  }
  static v1::PredictRequest Request(const std::vector<v1::Scenario>& scenarios) {
    v1::PredictRequest request;
    request.set_model("models/tiny");
    for (const v1::Scenario& scenario : scenarios) {
      v1::Scenario* observed = request.add_scenarios();
      *observed = scenario;
      client::StripFuture(observed);
    }
    return request;
  }
  // Compares the answers to scenes with their maps and to the same scenes with registered maps.
  static void ExpectSameAnswers(client::Client& client, const v1::PredictRequest& request) {
    const auto whole = client.Predict(request);
    ASSERT_TRUE(whole.ok()) << whole.status();
    ASSERT_FALSE(whole->predictions(0).has_error()) << whole->predictions(0).error().message();
    client::MapReuse maps(client);
    for (int i = 0; i < 2; ++i) {
      const auto named = maps.Predict(request);
      ASSERT_TRUE(named.ok()) << named.status();
      EXPECT_EQ(named->SerializeAsString(), whole->SerializeAsString());
    }
  }

  static std::unique_ptr<TrainedServer> trained_;
};

std::unique_ptr<TrainedServer> MapsTest::trained_;

TEST_F(MapsTest, RegisteredMapsGiveTheSameBits) {
  const auto client = Connect(trained_->server());
  ExpectSameAnswers(*client, Request(trained_->unseen()));
}

TEST_F(MapsTest, RequestsWithoutMapsHaveAtMostAFifthOfTheBytes) {
  const char* place = std::getenv("MANEUVER_REAL_DATA");
  if (place == nullptr) GTEST_SKIP() << "MANEUVER_REAL_DATA is not set";
  std::vector<v1::Scenario> scenarios;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(place)) {
    if (!entry.path().filename().string().starts_with("validation.tfrecord")) continue;
    auto reader = data::TfRecordReader::Open(entry.path());
    ASSERT_TRUE(reader.ok()) << reader.status();
    std::string payload;
    while (scenarios.size() < 10 && (*reader)->Next(&payload).ok()) {
      auto scenario = data::ParseWaymoScenario(payload);
      ASSERT_TRUE(scenario.ok()) << scenario.status();
      if (!scenario->target_ids().empty()) scenarios.push_back(*std::move(scenario));
    }
  }
  ASSERT_FALSE(scenarios.empty());
  const auto client = Connect(trained_->server());
  v1::PredictRequest request = Request(scenarios);
  ExpectSameAnswers(*client, request);

  const double whole = static_cast<double>(request.ByteSizeLong());
  client::MapReuse maps(*client);
  ASSERT_TRUE(maps.NameMaps(request.mutable_scenarios()).ok());
  EXPECT_LT(static_cast<double>(request.ByteSizeLong()), whole / 5.0);
}

TEST_F(MapsTest, TheClientRegistersALostMapAgain) {
  trained_->server().Terminate();
  const std::vector<v1::Scenario> scenes(trained_->unseen().begin(),
                                         trained_->unseen().begin() + 2);
  const v1::PredictRequest request = Request(scenes);
  v1::PredictRequest named = request;
  std::string expected;
  {
    ServerProcess server(trained_->data_dir());
    const auto client = Connect(server);
    client::MapReuse maps(*client);
    ASSERT_TRUE(maps.NameMaps(named.mutable_scenarios()).ok());
    const auto answer = client->Predict(named);
    ASSERT_TRUE(answer.ok()) << answer.status();
    expected = answer->SerializeAsString();
    EXPECT_EQ(server.Terminate(), 0);
  }
  // Maps are kept only in memory. This server has room for one, fewer than the request needs.
  ServerProcess server(trained_->data_dir(), {"--max-maps", "1"});
  const auto client = Connect(server);
  const absl::Status unknown = client->Predict(named).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(unknown)) << unknown;
  EXPECT_EQ(client::ErrorDetailsOf(unknown).reason, "MAP_NOT_REGISTERED");
  client::MapReuse maps(*client);
  for (int i = 0; i < 2; ++i) {
    const auto answer = maps.Predict(request);
    ASSERT_TRUE(answer.ok()) << answer.status();
    EXPECT_EQ(answer->SerializeAsString(), expected);
  }
}

// Checks that open streams do not prevent a shutdown.
TEST_F(MapsTest, AnIdleStreamDoesNotDelayTheShutdown) {
  trained_->server().Terminate();
  ServerProcess server(trained_->data_dir(), {"--shutdown-timeout", "25"});
  const auto client = Connect(server);
  std::promise<void> answered;
  const auto stream =
      client->StreamPredict([&](const v1::StreamPredictResponse&) { answered.set_value(); });
  ASSERT_TRUE(stream->Send("1", Request({trained_->unseen()[0]})).ok());
  // Waits for an answer, so that the server has the stream. gRPC cancels a stream that arrives
  // during the shutdown.
  ASSERT_EQ(answered.get_future().wait_for(std::chrono::seconds(30)), std::future_status::ready);
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(server.Terminate(), 0);
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(15));
  const absl::Status end = stream->Finish();
  EXPECT_TRUE(absl::IsUnavailable(end)) << end;
}

}  // namespace
}  // namespace maneuver::integration::maps_test
