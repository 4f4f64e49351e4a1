// The whole server over loopback, with networks that cost nothing.

#include "server/rpc/server.h"

#include <gmock/gmock.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <latch>
#include <limits>
#include <map>
#include <thread>

#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "server/monitoring/prometheus_metrics.h"
#include "server/rpc/model_service.h"
#include "server/rpc/predict_stream.h"
#include "server/rpc/prediction_service.h"
#include "server/security/secret_file.h"
#include "tests/unit/server/serving/fake_action_model.h"

namespace maneuver::rpc {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class MemoryAliasStore final : public serving::AliasStore {
 public:
  absl::Status SetAlias(const security::ModelAliasName& name, int version) override {
    aliases_[name] = version;
    return absl::OkStatus();
  }
  absl::StatusOr<int> GetAlias(const security::ModelAliasName& name) override {
    return aliases_.at(name);
  }
  absl::StatusOr<std::vector<serving::ModelAlias>> ListAliases() override {
    return std::vector<serving::ModelAlias>();
  }
  absl::Status DeleteAlias(const security::ModelAliasName& name) override {
    return aliases_.erase(name) == 1 ? absl::OkStatus() : absl::NotFoundError("no alias");
  }

 private:
  std::map<security::ModelAliasName, int> aliases_;
};

// ErrorInfo.reason of a failed call.
std::string Reason(const grpc::Status& status) {
  v1::Status details;
  v1::ErrorInfo info;
  if (!details.ParseFromString(status.error_details())) return "no details";
  for (const auto& any : details.details()) {
    if (any.type_url() == "type.googleapis.com/google.rpc.ErrorInfo") {
      info.ParseFromString(any.value());
    }
  }
  return info.reason();
}

v1::Scenario Scene() {
  v1::Scenario scenario;
  v1::Agent* agent = scenario.add_agents();
  agent->set_id(7);
  agent->set_type(v1::AGENT_TYPE_VEHICLE);
  agent->set_length(4);
  agent->set_width(2);
  agent->add_states()->set_x(100.0);
  scenario.add_target_ids(7);
  return scenario;
}

v1::PredictRequest OneScene() {
  v1::PredictRequest request;
  *request.add_scenarios() = Scene();
  return request;
}

class ServerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        fs::path(::testing::TempDir()) /
        ("server-" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    auto models = serving::ModelRegistry::Open(
        folder_ / "models", aliases_,
        [this](const fs::path&) -> absl::StatusOr<std::shared_ptr<const inference::ActionModel>> {
          return std::make_shared<serving::FakeActionModel>(networks_);
        },
        {.max_unaliased_in_memory = 0}, *metrics_);
    ASSERT_TRUE(models.ok()) << models.status();
    models_ = *std::move(models);
    scheduler_ = std::make_unique<serving::BatchScheduler>(
        serving::SchedulerOptions{.workers = 2, .queue = {.max_queue = 100}}, *metrics_);
    disk_ = std::make_unique<jobs::WorkerPool>(2, 100);
    context_ = std::make_unique<PredictionContext>(
        PredictionContext{*models_, *scheduler_, maps_, *disk_, {.map_by_id = true}, *access_});
    predictions_ = std::make_unique<PredictionService>(*context_);
    model_service_ = std::make_unique<ModelService>(*models_, *disk_);
    auto server = Server::Start({"127.0.0.1", 0},
                                {{v1::PredictionService::service_full_name(), predictions_.get()},
                                 {v1::ModelService::service_full_name(), model_service_.get()}},
                                *access_, *metrics_);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
    models_->OnReadyChange([this](bool ready) { server_->SetPredictionsReady(ready); });
    channel_ =
        grpc::CreateChannel(server_->address().ToString(), grpc::InsecureChannelCredentials());
    stub_ = v1::PredictionService::NewStub(channel_);
    model_stub_ = v1::ModelService::NewStub(channel_);
  }

  void TearDown() override {
    networks_.OpenGate();
    if (server_ != nullptr) server_->Shutdown(std::chrono::system_clock::now());
    server_ = nullptr;
    disk_ = nullptr;
    scheduler_ = nullptr;
    fs::remove_all(folder_);
  }

  void Publish(const std::string& model = "town") {
    const fs::path finished = folder_ / "finished";
    fs::create_directories(finished);
    std::ofstream(finished / "weights.safetensors") << "x";
    const auto name = models_->Publish(model, finished, v1::PROMOTION_UNSPECIFIED);
    ASSERT_TRUE(name.ok()) << name.status();
  }

  grpc::Status Predict(const v1::PredictRequest& request, v1::PredictResponse* response) {
    grpc::ClientContext context;
    return stub_->Predict(&context, request, response);
  }

  // grpc.health.v1: 1 is SERVING, 2 is NOT_SERVING.
  int Health(const std::string& service) {
    std::string request = "\x0a";
    request += static_cast<char>(service.size());
    request += service;
    const grpc::Slice slice(request);
    grpc::ByteBuffer buffer(&slice, 1);
    grpc::ByteBuffer answer;
    grpc::ClientContext context;
    grpc::Status status;
    grpc::CompletionQueue queue;
    auto call = grpc::GenericStub(channel_).PrepareUnaryCall(
        &context, "/grpc.health.v1.Health/Check", buffer, &queue);
    call->StartCall();
    call->Finish(&answer, &status, this);
    void* tag = nullptr;
    bool ok = false;
    queue.Next(&tag, &ok);
    grpc::Slice bytes;
    if (!status.ok() || !answer.DumpToSingleSlice(&bytes).ok() || bytes.size() != 2) return -1;
    return bytes.begin()[1];
  }

  fs::path folder_;
  const std::unique_ptr<monitoring::PrometheusMetrics> metrics_ =
      monitoring::PrometheusMetrics::Create();
  const std::unique_ptr<security::AccessControl> access_ =
      *security::AccessControl::Create({}, *metrics_);
  MemoryAliasStore aliases_;
  serving::FakeNetworks networks_;
  std::unique_ptr<serving::ModelRegistry> models_;
  std::unique_ptr<serving::BatchScheduler> scheduler_;
  serving::MapCache maps_{{.max_maps = 2}, *metrics_};
  std::unique_ptr<jobs::WorkerPool> disk_;
  std::unique_ptr<PredictionContext> context_;
  std::unique_ptr<PredictionService> predictions_;
  std::unique_ptr<ModelService> model_service_;
  std::unique_ptr<Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::PredictionService::Stub> stub_;
  std::unique_ptr<v1::ModelService::Stub> model_stub_;
};

TEST_F(ServerTest, WithoutAModelTheAnswerSaysWhatToDo) {
  v1::PredictResponse response;
  const grpc::Status status = Predict(OneScene(), &response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(Reason(status), "NO_MODEL_SERVES");
}

TEST_F(ServerTest, HealthTellsTheTruth) {
  const std::string predictions = "maneuver.v1.PredictionService";
  EXPECT_EQ(Health(predictions), 2);
  EXPECT_EQ(Health("maneuver.v1.ModelService"), 1);
  EXPECT_EQ(Health(""), 1);
  Publish();
  EXPECT_EQ(Health(predictions), 1);
  ASSERT_TRUE(models_->DeleteAlias({"town", "serving"}).ok());
  EXPECT_EQ(Health(predictions), 2);
  server_->TurnHealth();
  EXPECT_EQ(Health(""), 2);
  EXPECT_EQ(Health("maneuver.v1.ModelService"), 2);
}

TEST_F(ServerTest, ABadScenarioFailsAloneAndTheRestIsAnswered) {
  Publish();
  v1::PredictRequest request = OneScene();
  *request.add_scenarios() = Scene();
  request.mutable_scenarios(0)->mutable_agents(0)->set_length(-1);
  request.mutable_query()->set_frame(v1::FRAME_TARGET);
  v1::PredictResponse response;
  const grpc::Status status = Predict(request, &response);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(response.model_version(), "models/town/versions/1");
  EXPECT_THAT(response.waypoint_times(), ElementsAre(1.0, 2.0));
  EXPECT_THAT(response.predictions(0).error().message(),
              HasSubstr("scenarios[0].agents[0].length"));
  EXPECT_EQ(response.predictions(0).targets_size(), 0);
  const v1::TargetPrediction& target = response.predictions(1).targets(0);
  EXPECT_THAT(target.probabilities(), ElementsAre(0.2, 0.5, 0.3));
  ASSERT_EQ(target.distributions_size(), 3);
  EXPECT_EQ(target.distributions(0).action_id(), 1);
  EXPECT_EQ(target.distributions(0).mean_trajectory().x(0), 1.0);
}

TEST_F(ServerTest, EachMethodAnswersWhatItIsFor) {
  Publish();
  {
    v1::PredictActionProbabilitiesRequest request;
    *request.add_scenarios() = Scene();
    v1::PredictActionProbabilitiesResponse response;
    grpc::ClientContext context;
    ASSERT_TRUE(stub_->PredictActionProbabilities(&context, request, &response).ok());
    EXPECT_EQ(response.predictions(0).targets(0).probabilities_size(), 3);
    EXPECT_EQ(response.predictions(0).targets(0).distributions_size(), 0);
  }
  {
    v1::PredictActionDistributionsRequest request;
    *request.add_scenarios() = Scene();
    request.mutable_query()->set_top_k(1);
    v1::PredictActionDistributionsResponse response;
    grpc::ClientContext context;
    ASSERT_TRUE(stub_->PredictActionDistributions(&context, request, &response).ok());
    EXPECT_EQ(response.predictions(0).targets(0).probabilities_size(), 0);
    EXPECT_EQ(response.predictions(0).targets(0).distributions_size(), 1);
  }
  {
    v1::ClassifyTrajectoriesRequest request;
    *request.add_scenarios() = Scene();
    *request.add_scenarios() = Scene();
    for (int i = 1; i <= 20; ++i) {
      v1::AgentState* state = request.mutable_scenarios(1)->mutable_agents(0)->add_states();
      state->set_time(0.1 * i);
      state->set_x(100.0 + 0.5 * i);
    }
    v1::ClassifyTrajectoriesResponse response;
    grpc::ClientContext context;
    ASSERT_TRUE(stub_->ClassifyTrajectories(&context, request, &response).ok());
    EXPECT_THAT(response.classifications(0).targets(0).error().message(),
                HasSubstr("scenarios[0].agents[0].states"));
    const v1::TargetClassification& target = response.classifications(1).targets(0);
    EXPECT_THAT(target.responsibilities(), ElementsAre(1.0, 0.0, 0.0));
    EXPECT_NEAR(target.log_likelihood_bound(), 5.0, 1e-9);  // x after 1 s
  }
}

TEST_F(ServerTest, RequestsThatAreWrongAsAWholeAreRefused) {
  Publish();
  v1::PredictResponse response;
  EXPECT_EQ(Predict({}, &response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  v1::PredictRequest request = OneScene();
  request.set_model("models/../etc");
  EXPECT_EQ(Predict(request, &response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  request.set_model("models/elsewhere");
  EXPECT_EQ(Predict(request, &response).error_code(), grpc::StatusCode::NOT_FOUND);
  request.clear_model();
  request.mutable_query()->mutable_action_ids()->add_ids(3);
  EXPECT_EQ(Predict(request, &response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(ServerTest, AVersionThatIsNotInMemoryIsLoadedForTheRequest) {
  Publish();
  Publish();
  v1::PredictRequest request = OneScene();
  request.set_model("models/town/versions/2");
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(request, &response).ok());
  EXPECT_EQ(response.model_version(), "models/town/versions/2");
}

TEST_F(ServerTest, AStreamAnswersRequestsAsTheyFinish) {
  Publish();
  networks_.CloseGate();
  const size_t before = networks_.batches().size();
  grpc::ClientContext context;
  auto stream = stub_->StreamPredict(&context);
  v1::StreamPredictRequest request;
  request.set_request_id("slow");
  *request.mutable_request() = OneScene();
  ASSERT_TRUE(stream->Write(request));
  networks_.AwaitBatches(before + 1);
  request.set_request_id("late");
  request.mutable_timeout();
  ASSERT_TRUE(stream->Write(request));
  request.set_request_id("bad");
  request.clear_timeout();
  request.mutable_request()->set_model("x");
  ASSERT_TRUE(stream->Write(request));
  ASSERT_TRUE(stream->WritesDone());

  v1::StreamPredictResponse response;
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_EQ(response.request_id(), "late");
  EXPECT_EQ(response.error().code(), grpc::StatusCode::DEADLINE_EXCEEDED);
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_EQ(response.request_id(), "bad");
  EXPECT_EQ(response.error().code(), grpc::StatusCode::INVALID_ARGUMENT);
  networks_.OpenGate();
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_EQ(response.request_id(), "slow");
  EXPECT_EQ(response.response().predictions(0).targets(0).probabilities_size(), 3);
  EXPECT_FALSE(stream->Read(&response));
  EXPECT_TRUE(stream->Finish().ok());
}

// Bytes that are a StreamPredictRequest but for the scenes in it, which would not parse.
std::string WithoutSense(int timeout_nanos) {
  v1::StreamPredictRequest request;
  request.set_request_id("no sense");
  if (timeout_nanos > 0) request.mutable_timeout()->set_nanos(timeout_nanos);
  return request.SerializeAsString() + "\x12\x03\xff\xff\xff";
}

TEST_F(ServerTest, AStreamIsToldThatTheDeadlineIsTooCloseBeforeItsRequestIsParsed) {
  Publish();
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  const auto finished = [&queue] {
    void* tag = nullptr;
    bool ok = false;
    return queue.Next(&tag, &ok) && ok;
  };
  auto stream = grpc::GenericStub(channel_).PrepareCall(
      &context, "/maneuver.v1.PredictionService/StreamPredict", &queue);
  stream->StartCall(nullptr);
  ASSERT_TRUE(finished());
  const auto ask = [&](const std::string& bytes) {
    const grpc::Slice slice(bytes);
    stream->Write(grpc::ByteBuffer(&slice, 1), nullptr);
    EXPECT_TRUE(finished());
    grpc::ByteBuffer answer;
    stream->Read(&answer, nullptr);
    EXPECT_TRUE(finished());
    grpc::Slice whole;
    v1::StreamPredictResponse response;
    EXPECT_TRUE(answer.DumpToSingleSlice(&whole).ok());
    EXPECT_TRUE(response.ParseFromArray(whole.begin(), static_cast<int>(whole.size())));
    EXPECT_EQ(response.request_id(), "no sense");
    return response.error().code();
  };
  constexpr int kMillisecond = 1'000'000;
  EXPECT_EQ(ask(WithoutSense(100 * kMillisecond)), grpc::StatusCode::INVALID_ARGUMENT);

  // Both workers are at work, and others wait for them.
  networks_.CloseGate();
  grpc::ClientContext waiting_context;
  const auto waiting = stub_->StreamPredict(&waiting_context);
  v1::StreamPredictRequest request;
  *request.mutable_request() = OneScene();
  const size_t warm_up = networks_.batches().size();
  for (int i = 0; i < 60; ++i) ASSERT_TRUE(waiting->Write(request));
  networks_.AwaitBatches(warm_up + 2);
  EXPECT_EQ(ask(WithoutSense(kMillisecond)), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(ask(WithoutSense(0)), grpc::StatusCode::INVALID_ARGUMENT);  // who has time
  networks_.OpenGate();
  waiting_context.TryCancel();
  waiting->Finish();
  context.TryCancel();
  grpc::Status status;
  stream->Finish(&status, nullptr);
  finished();
}

TEST_F(ServerTest, AStreamTakesAnyNumberOfRequests) {
  Publish();
  constexpr int kRequests = 300;  // several times what may be in flight
  grpc::ClientContext context;
  auto stream = stub_->StreamPredict(&context);
  std::thread writer([&] {
    v1::StreamPredictRequest request;
    *request.mutable_request() = OneScene();
    for (int i = 0; i < kRequests; ++i) {
      request.set_request_id(std::to_string(i));
      stream->Write(request);
    }
    stream->WritesDone();
  });
  std::set<std::string> answered;
  v1::StreamPredictResponse response;
  while (stream->Read(&response)) {
    EXPECT_TRUE(response.has_response()) << response.error().message();
    answered.insert(response.request_id());
  }
  writer.join();
  EXPECT_TRUE(stream->Finish().ok());
  EXPECT_EQ(answered.size(), static_cast<size_t>(kRequests));
}

TEST_F(ServerTest, ARequestReachesTheShadowOnceItsCallerIsAnswered) {
  Publish();
  Publish();
  ASSERT_TRUE(models_->SetAlias({"town", "candidate"}, 2).ok());
  // It has room for nothing, and so counts at once what it is offered.
  context_->shadow = std::make_shared<serving::Shadow>(
      serving::ShadowOptions{.fraction = 1.0, .max_targets = 0}, *models_, [] { return true; },
      *metrics_);
  const auto offered = [this] {
    return metrics_->Page().find("maneuver_shadow_targets_total{outcome=\"dropped\"} 0\n") ==
           std::string::npos;
  };
  const v1::PredictRequest request = OneScene();
  v1::PredictResponse response;
  std::latch finished(1);
  auto kept = std::make_shared<int>();
  const std::weak_ptr<int> watched = kept;
  const auto run =
      PredictionRun::Start(*context_, PredictIo(request, &response), serving::TimePoint::max(),
                           std::move(kept), [&](const absl::Status& status) {
                             EXPECT_TRUE(status.ok()) << status;
                             EXPECT_EQ(response.predictions_size(), 1);
                             EXPECT_FALSE(offered());
                             finished.count_down();
                           });
  finished.wait();
  scheduler_ = nullptr;  // ends once its workers have
  EXPECT_TRUE(offered());
  EXPECT_TRUE(watched.expired());
}

TEST_F(ServerTest, PriorityAndBytesOfARequestReachTheQueue) {
  Publish();
  networks_.CloseGate();
  const size_t before = networks_.batches().size();
  const v1::PredictRequest request = OneScene();
  std::vector<v1::PredictResponse> responses(4);
  std::latch finished(4);
  const auto start = [&](size_t i, v1::Priority priority) {
    PredictionIo io = PredictIo(request, &responses[i]);
    io.priority = priority;
    return PredictionRun::Start(*context_, io, serving::TimePoint::max(), nullptr,
                                [&](const absl::Status& status) {
                                  EXPECT_TRUE(status.ok()) << status;
                                  finished.count_down();
                                });
  };
  // Both workers are busy; what comes now waits.
  const auto first = start(0, v1::PRIORITY_UNSPECIFIED);
  networks_.AwaitBatches(before + 1);
  const auto second = start(1, v1::PRIORITY_UNSPECIFIED);
  networks_.AwaitBatches(before + 2);
  const auto bulk = start(2, v1::PRIORITY_BULK);
  const auto interactive = start(3, v1::PRIORITY_INTERACTIVE);
  const std::string page = metrics_->Page();
  for (const char* priority : {"bulk", "interactive"}) {
    const std::string label = std::string("{priority=\"") + priority + "\"} ";
    EXPECT_THAT(page, HasSubstr("maneuver_queue_targets" + label + "1\n"));
    EXPECT_THAT(page, HasSubstr("maneuver_queue_bytes" + label +
                                std::to_string(request.ByteSizeLong()) + "\n"));
  }
  networks_.OpenGate();
  finished.wait();
}

TEST_F(ServerTest, APriorityThatDoesNotExistIsRefused) {
  Publish();
  v1::PredictRequest request = OneScene();
  request.set_priority(static_cast<v1::Priority>(9));
  v1::PredictResponse response;
  EXPECT_EQ(Predict(request, &response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(ServerTest, WorkStopsWhenTheCallerHasGone) {
  Publish();
  const int described = networks_.described();
  const size_t before = networks_.batches().size();
  networks_.CloseGate();
  {
    grpc::ClientContext context;
    auto stream = stub_->StreamPredict(&context);
    v1::StreamPredictRequest request;
    *request.mutable_request() = OneScene();
    ASSERT_TRUE(stream->Write(request));
    networks_.AwaitBatches(before + 1);
    context.TryCancel();
    EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::CANCELLED);
  }
  {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(30));
    v1::PredictResponse response;
    EXPECT_EQ(stub_->Predict(&context, OneScene(), &response).error_code(),
              grpc::StatusCode::DEADLINE_EXCEEDED);
  }
  networks_.OpenGate();
  // Shutdown waits for both calls to come to their end.
  server_->Shutdown(std::chrono::system_clock::now() + std::chrono::seconds(10));
  EXPECT_LE(networks_.described(), described + 1);  // of the stream, if its cancellation came late
}

TEST_F(ServerTest, AScenarioMayNameARegisteredMap) {
  Publish();
  v1::PredictRequest own = OneScene();
  v1::MapFeature* lane = own.mutable_scenarios(0)->add_map_features();
  lane->set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  for (const double x : {90.0, 110.0}) {
    lane->add_x(x);
    lane->add_y(3.0);
  }
  v1::PredictResponse expected;
  ASSERT_TRUE(Predict(own, &expected).ok());
  v1::PredictResponse without;
  ASSERT_TRUE(Predict(OneScene(), &without).ok());
  ASSERT_NE(expected.SerializeAsString(), without.SerializeAsString());

  const auto register_map = [&](v1::RegisterMapResponse* registered) {
    v1::RegisterMapRequest request;
    *request.mutable_map_features() = own.scenarios(0).map_features();
    grpc::ClientContext context;
    return stub_->RegisterMap(&context, request, registered);
  };
  v1::PredictRequest named = OneScene();
  named.mutable_scenarios(0)->set_map_id(serving::MapId(own.scenarios(0).map_features()));
  v1::PredictResponse response;
  const grpc::Status unknown = Predict(named, &response);
  EXPECT_EQ(unknown.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(Reason(unknown), "MAP_NOT_REGISTERED");
  EXPECT_THAT(unknown.error_message(), HasSubstr("register it with RegisterMap"));

  v1::RegisterMapResponse registered;
  ASSERT_TRUE(register_map(&registered).ok());
  EXPECT_EQ(registered.map_id(), named.scenarios(0).map_id());
  EXPECT_GT(registered.size_bytes(), 32);
  ASSERT_TRUE(Predict(named, &response).ok());
  EXPECT_EQ(response.SerializeAsString(), expected.SerializeAsString());

  lane->set_x(0, std::numeric_limits<double>::infinity());
  const grpc::Status refused = register_map(&registered);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(refused.error_message(), HasSubstr("map_features[0].x[0]"));
}

TEST_F(ServerTest, AScenarioWithAMapIdThatCannotBeOneFailsAlone) {
  Publish();
  v1::PredictRequest request = OneScene();
  *request.add_scenarios() = Scene();
  request.mutable_scenarios(0)->set_map_id("../../etc/passwd");
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(request, &response).ok());
  EXPECT_THAT(response.predictions(0).error().message(), HasSubstr("scenarios[0].map_id"));
  EXPECT_EQ(response.predictions(1).targets_size(), 1);
}

TEST_F(ServerTest, IdleStreamsDoNotHoldUpTheEnd) {
  Publish();
  v1::StreamPredictRequest request;
  *request.mutable_request() = OneScene();
  v1::StreamPredictResponse response;
  grpc::ClientContext idle_context;
  const auto idle = stub_->StreamPredict(&idle_context);
  ASSERT_TRUE(idle->Write(request));
  ASSERT_TRUE(idle->Read(&response));
  grpc::ClientContext busy_context;
  const auto busy = stub_->StreamPredict(&busy_context);
  const size_t before = networks_.batches().size();
  networks_.CloseGate();
  request.set_request_id("in flight");
  ASSERT_TRUE(busy->Write(request));
  networks_.AwaitBatches(before + 1);

  const auto start = std::chrono::steady_clock::now();
  predictions_->Drain();
  EXPECT_FALSE(idle->Read(&response));
  const grpc::Status idle_end = idle->Finish();
  EXPECT_EQ(idle_end.error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(Reason(idle_end), "SHUTTING_DOWN");

  std::thread end(
      [this] { server_->Shutdown(std::chrono::system_clock::now() + std::chrono::minutes(1)); });
  networks_.OpenGate();
  ASSERT_TRUE(busy->Read(&response));
  EXPECT_EQ(response.request_id(), "in flight");
  EXPECT_TRUE(response.has_response());
  EXPECT_FALSE(busy->Read(&response));
  EXPECT_EQ(busy->Finish().error_code(), grpc::StatusCode::UNAVAILABLE);
  end.join();
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(30));
}

TEST_F(ServerTest, AStreamThatIsOpenedAfterTheDrainEndsAtOnce) {
  predictions_->Drain();
  grpc::ClientContext context;
  const auto stream = stub_->StreamPredict(&context);
  v1::StreamPredictResponse response;
  EXPECT_FALSE(stream->Read(&response));
  EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::UNAVAILABLE);
}

TEST_F(ServerTest, CompressedRequestsAreRefused) {
  Publish();
  grpc::ClientContext context;
  context.set_compression_algorithm(GRPC_COMPRESS_GZIP);
  v1::PredictResponse response;
  v1::PredictRequest request = OneScene();
  // Compressible, or the client sends it as it is.
  request.mutable_scenarios(0)->set_scenario_id(std::string(100, 'a'));
  EXPECT_EQ(stub_->Predict(&context, request, &response).error_code(),
            grpc::StatusCode::UNIMPLEMENTED);
}

TEST_F(ServerTest, EveryCallIsCountedByMethodAndCode) {
  Publish();
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(OneScene(), &response).ok());
  ASSERT_FALSE(Predict({}, &response).ok());
  server_->Shutdown(std::chrono::system_clock::now() + std::chrono::seconds(10));
  const std::string page = metrics_->Page();
  EXPECT_THAT(page, HasSubstr("maneuver_requests_total{code=\"OK\",method=\"PredictionService/"
                              "Predict\"} 1"));
  EXPECT_THAT(page, HasSubstr("maneuver_requests_total{code=\"INVALID_ARGUMENT\",method="
                              "\"PredictionService/Predict\"} 1"));
  for (const char* code : {"OK", "INVALID_ARGUMENT"}) {
    EXPECT_THAT(page, HasSubstr("maneuver_request_duration_seconds_count{code=\"" +
                                std::string(code) + "\",method=\"PredictionService/Predict\"} 1"));
  }
  EXPECT_THAT(page, HasSubstr("maneuver_targets_total{outcome=\"answered\"} 1"));
  EXPECT_THAT(page,
              HasSubstr("maneuver_requests_in_flight{method=\"PredictionService/Predict\"} 0"));
}

TEST_F(ServerTest, VersionsArePagedNewestFirst) {
  for (int i = 0; i < 5; ++i) Publish();
  v1::ListModelVersionsRequest request;
  request.set_parent("models/-");
  request.set_page_size(2);
  std::vector<std::string> names;
  do {
    v1::ListModelVersionsResponse response;
    grpc::ClientContext context;
    const grpc::Status status = model_stub_->ListModelVersions(&context, request, &response);
    ASSERT_TRUE(status.ok()) << status.error_message();
    for (const auto& version : response.model_versions())
      names.push_back(version.name().substr(21));
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  EXPECT_THAT(names, ElementsAre("5", "4", "3", "2", "1"));

  request.set_page_token("nonsense");
  v1::ListModelVersionsResponse response;
  grpc::ClientContext context;
  EXPECT_EQ(model_stub_->ListModelVersions(&context, request, &response).error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(ServerTest, ReportsOfAVersionArePagedNewestFirstAndReadWhole) {
  Publish();
  int64_t seconds = 0;
  for (const char* dataset : {"a", "b", "c", "d", "e"}) {
    v1::EvaluationReport report;
    report.set_model_version("models/town/versions/1");
    report.set_dataset(std::string("datasets/") + dataset);
    report.mutable_create_time()->set_seconds(++seconds);
    report.add_strata()->set_name("left");
    ASSERT_TRUE(models_->KeepReport(report).ok());
  }
  v1::ListEvaluationReportsRequest request;
  request.set_parent("models/town");  // what serves
  request.set_page_size(2);
  std::vector<std::string> datasets;
  std::string last;
  do {
    v1::ListEvaluationReportsResponse response;
    grpc::ClientContext context;
    const grpc::Status status = model_stub_->ListEvaluationReports(&context, request, &response);
    ASSERT_TRUE(status.ok()) << status.error_message();
    EXPECT_LE(response.evaluation_reports_size(), 2);
    for (const auto& report : response.evaluation_reports()) {
      datasets.push_back(report.dataset().substr(9));
      last = report.name();
    }
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  EXPECT_THAT(datasets, ElementsAre("e", "d", "c", "b", "a"));

  v1::GetEvaluationReportRequest get;
  get.set_name(last);
  v1::EvaluationReport report;
  {
    grpc::ClientContext context;
    ASSERT_TRUE(model_stub_->GetEvaluationReport(&context, get, &report).ok());
    EXPECT_EQ(report.dataset(), "datasets/a");
    EXPECT_EQ(report.strata_size(), 1);
  }
  {
    get.set_name("models/town/versions/1/evaluations/f");
    grpc::ClientContext context;
    const grpc::Status status = model_stub_->GetEvaluationReport(&context, get, &report);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND);
    EXPECT_EQ(Reason(status), "EVALUATION_NOT_FOUND");
  }
  request.set_page_token("nonsense");
  v1::ListEvaluationReportsResponse response;
  grpc::ClientContext context;
  EXPECT_EQ(model_stub_->ListEvaluationReports(&context, request, &response).error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(ServerTest, PromotionIsAnAliasAndAnAliasedVersionStays) {
  Publish();
  Publish();
  v1::SetModelAliasRequest set;
  set.set_name("models/town/aliases/serving");
  set.set_model_version("models/town/versions/2");
  {
    v1::ModelAlias alias;
    grpc::ClientContext context;
    ASSERT_TRUE(model_stub_->SetModelAlias(&context, set, &alias).ok());
  }
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(OneScene(), &response).ok());
  EXPECT_EQ(response.model_version(), "models/town/versions/2");

  v1::DeleteModelVersionRequest remove;
  google::protobuf::Empty empty;
  {
    remove.set_name("models/town/versions/2");
    grpc::ClientContext context;
    const grpc::Status status = model_stub_->DeleteModelVersion(&context, remove, &empty);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
    EXPECT_EQ(Reason(status), "MODEL_VERSION_IN_USE");
  }
  {
    remove.set_name("models/town/versions/1");
    grpc::ClientContext context;
    EXPECT_TRUE(model_stub_->DeleteModelVersion(&context, remove, &empty).ok());
  }
  set.set_model_version("models/city/versions/1");
  v1::ModelAlias alias;
  grpc::ClientContext context;
  EXPECT_EQ(model_stub_->SetModelAlias(&context, set, &alias).error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);
}

// gRPC's own messages are handed over by hand on the way to a method (guarded_service.cc): each way
// is gone once, for the leak checker's sake too.
TEST_F(ServerTest, RefusedEmptyAndMalformedCallsOfEachKindAreAnswered) {
  Publish();
  ASSERT_TRUE(security::AppendLine(folder_ / "tokens", "# nobody\n").ok());
  const auto nobody =
      security::AccessControl::Create({.identities = folder_ / "tokens"}, *metrics_);
  ASSERT_TRUE(nobody.ok()) << nobody.status();
  const auto closed = Server::Start(
      {"127.0.0.1", 0}, {{v1::PredictionService::service_full_name(), predictions_.get()}},
      **nobody, *metrics_);
  ASSERT_TRUE(closed.ok()) << closed.status();
  const auto channel =
      grpc::CreateChannel((*closed)->address().ToString(), grpc::InsecureChannelCredentials());
  const auto stub = v1::PredictionService::NewStub(channel);
  {
    grpc::ClientContext context;
    v1::PredictResponse response;
    EXPECT_EQ(stub->Predict(&context, OneScene(), &response).error_code(),
              grpc::StatusCode::UNAUTHENTICATED);
  }
  {
    grpc::ClientContext context;
    const auto stream = stub->StreamPredict(&context);
    stream->Write({});
    EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::UNAUTHENTICATED);
  }
  // Let in, but with bytes that are no message, and with no message at all.
  for (const auto& to : {channel_, channel}) {
    const grpc::Slice garbage(std::string("\xff\xff\xff"));
    grpc::ByteBuffer request(&garbage, 1);
    grpc::ByteBuffer answer;
    grpc::ClientContext context;
    grpc::Status status;
    grpc::CompletionQueue queue;
    auto call = grpc::GenericStub(to).PrepareUnaryCall(
        &context, "/maneuver.v1.PredictionService/Predict", request, &queue);
    call->StartCall();
    call->Finish(&answer, &status, this);
    void* tag = nullptr;
    bool ok = false;
    queue.Next(&tag, &ok);
    EXPECT_FALSE(status.ok());
    EXPECT_EQ(status.error_code() == grpc::StatusCode::UNAUTHENTICATED, to == channel);
  }
  for (const auto& to : {channel_, channel}) {
    grpc::ClientContext context;
    grpc::CompletionQueue queue;
    const auto finished = [&queue] {
      void* tag = nullptr;
      bool ok = false;
      queue.Next(&tag, &ok);
    };
    auto call = grpc::GenericStub(to).PrepareCall(&context,
                                                  "/maneuver.v1.PredictionService/Predict", &queue);
    call->StartCall(nullptr);
    finished();
    call->WritesDone(nullptr);
    finished();
    grpc::Status status;
    call->Finish(&status, nullptr);
    finished();
    EXPECT_FALSE(status.ok());
  }
  v1::PredictResponse response;
  EXPECT_TRUE(Predict(OneScene(), &response).ok());
}

TEST_F(ServerTest, ATakenPortIsAnError) {
  const auto second = Server::Start(
      server_->address(), {{v1::PredictionService::service_full_name(), predictions_.get()}},
      *access_, *metrics_);
  EXPECT_TRUE(absl::IsUnavailable(second.status()));
}

}  // namespace
}  // namespace maneuver::rpc
