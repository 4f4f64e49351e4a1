// Swaps versions while callers ask for predictions.

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "model/artifact/model_folder.h"
#include "tests/integration/server_process.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/model/inference/reference_model.h"

namespace maneuver::integration::swaps_test {
namespace {

namespace fs = std::filesystem;

constexpr int kVersions = 2;
constexpr int kScenes = 8;
constexpr int kCallers = 4;

std::string Version(int version) { return "models/tiny/versions/" + std::to_string(version); }

// A request with one vehicle; its speed differs from scene to scene.
v1::PredictRequest Request(int scene, const std::string& model) {
  v1::PredictRequest request;
  request.set_model(model);
  request.mutable_query()->set_min_probability(0.0);
  v1::Scenario& scenario = *request.add_scenarios();
  scenario.set_prediction_time(1.0);
  scenario.add_target_ids(7);
  v1::Agent& agent = *scenario.add_agents();
  agent.set_id(7);
  agent.set_type(v1::AGENT_TYPE_VEHICLE);
  agent.set_length(4.5);
  agent.set_width(1.9);
  for (const double time : {0.0, 1.0}) {
    v1::AgentState& state = *agent.add_states();
    state.set_time(time);
    state.set_x((2.0 + scene) * time);
    state.set_velocity_x(2.0 + scene);
  }
  return request;
}

// Returns the part of an answer that depends on the model: probabilities and distributions, to the
// last bit.
std::string Content(v1::PredictResponse response) {
  response.clear_model_version();
  return response.SerializeAsString();
}

TEST(SwapsTest, EachAnswerComesFromOneVersionWhileVersionsAreSwapped) {
  const char* more = std::getenv("MANEUVER_SWAPS");
  const int swaps = more == nullptr ? 200 : std::atoi(more);
  const TemporaryFolder folder;
  const fs::path data = folder.path() / "data";
  fs::create_directories(data / "models" / "tiny");
  for (int version = 1; version <= kVersions; ++version) {
    const auto written = artifact::WriteModelFolder(
        data / "models" / "tiny" / std::to_string(version),
        inference::RandomModel(artifact::TinySpec(), static_cast<uint32_t>(version)));
    ASSERT_TRUE(written.ok()) << written;
  }
  ServerProcess server(data, {"--precision", "f32"});
  const auto predictions = v1::PredictionService::NewStub(server.channel());
  const auto models = v1::ModelService::NewStub(server.channel());
  const auto serve = [&](int version) {
    v1::SetModelAliasRequest request;
    request.set_name("models/tiny/aliases/serving");
    request.set_model_version(Version(version));
    grpc::ClientContext context;
    v1::ModelAlias alias;
    return models->SetModelAlias(&context, request, &alias);
  };
  const auto predict = [&](const v1::PredictRequest& request, v1::PredictResponse* response) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
    return predictions->Predict(&context, request, response);
  };
  ASSERT_TRUE(serve(1).ok());

  std::array<std::array<std::string, kScenes>, kVersions> expected;
  for (int version = 1; version <= kVersions; ++version) {
    for (int scene = 0; scene < kScenes; ++scene) {
      v1::PredictResponse response;
      const auto status = predict(Request(scene, Version(version)), &response);
      ASSERT_TRUE(status.ok()) << status.error_message();
      ASSERT_EQ(response.predictions(0).targets(0).distributions_size(), 3);
      expected[version - 1][scene] = Content(response);
    }
  }
  ASSERT_NE(expected[0], expected[1]);

  std::atomic<bool> enough = false;
  std::array<std::atomic<int>, kVersions> answers = {};
  std::atomic<int> wrong = 0;
  std::vector<std::thread> callers;
  for (int caller = 0; caller < kCallers; ++caller) {
    callers.emplace_back([&, caller] {
      for (int i = caller; !enough; ++i) {
        const int scene = i % kScenes;
        v1::PredictResponse response;
        const auto status = predict(Request(scene, "models/tiny"), &response);
        bool right = false;
        for (int version = 1; status.ok() && version <= kVersions; ++version) {
          if (response.model_version() != Version(version)) continue;
          right = Content(response) == expected[version - 1][scene];
          ++answers[version - 1];
        }
        if (!right && wrong++ < 3)
          ADD_FAILURE() << status.error_message() << response.DebugString();
      }
    });
  }
  // Each swap waits for an answer, so that some caller sees it.
  for (int swap = 1; swap <= swaps; ++swap) {
    const int before = answers[0] + answers[1];
    const auto status = serve(1 + swap % kVersions);
    EXPECT_TRUE(status.ok()) << status.error_message();
    while (answers[0] + answers[1] == before && wrong == 0) std::this_thread::yield();
  }
  enough = true;
  for (std::thread& caller : callers) caller.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(answers[0], swaps / 10);
  EXPECT_GT(answers[1], swaps / 10);
  RecordProperty("answers", answers[0] + answers[1]);
}

}  // namespace
}  // namespace maneuver::integration::swaps_test
