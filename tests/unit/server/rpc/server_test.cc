#include "server/rpc/server.h"

#include <gmock/gmock.h>
#include <grpc/support/time.h>

#include <atomic>
#include <latch>
#include <limits>
#include <list>
#include <stop_token>
#include <thread>

#include "absl/strings/str_cat.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "grpc/reflection/v1/reflection.grpc.pb.h"
#include "server/errors/error_details.h"
#include "server/rpc/message_gate.h"
#include "server/rpc/open_connections.h"
#include "server/rpc/predict_stream.h"
#include "server/security/identities.h"
#include "server/security/secret_file.h"
#include "tests/integration/raw_http2.h"
#include "tests/unit/server/rpc/server_fixture.h"

namespace maneuver::rpc::server_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST_F(ServerTest, WithoutAModelTheAnswerSaysWhatToDo) {
  v1::PredictResponse response;
  const grpc::Status status = Predict(OneScene(), &response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(Reason(status), "NO_MODEL_SERVES");
}

TEST_F(ServerTest, HealthFollowsTheServersState) {
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

TEST_F(ServerTest, ABadScenarioFailsAlone) {
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

TEST_F(ServerTest, EachMethodReturnsItsAnswer) {
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

TEST_F(ServerTest, EachMethodReturnsActionNamesOnRequest) {
  Publish();
  const auto names_of = [](auto request, const auto& ask) {
    *request.add_scenarios() = Scene();
    EXPECT_THAT(ask(request).action_names(), IsEmpty());
    request.set_include_action_names(true);
    const auto names = ask(request).action_names();
    return std::vector<std::string>(names.begin(), names.end());
  };
  const auto asking = [this](auto method, auto response) {
    return [this, method, response](const auto& request) {
      auto answer = response;
      grpc::ClientContext context;
      EXPECT_TRUE((stub_.get()->*method)(&context, request, &answer).ok());
      return answer;
    };
  };
  using Stub = v1::PredictionService::Stub;
  const auto all = ElementsAre("action 0", "action 1", "action 2");
  EXPECT_THAT(names_of(v1::PredictRequest(), asking(&Stub::Predict, v1::PredictResponse())), all);
  EXPECT_THAT(
      names_of(v1::PredictActionProbabilitiesRequest(),
               asking(&Stub::PredictActionProbabilities, v1::PredictActionProbabilitiesResponse())),
      all);
  EXPECT_THAT(
      names_of(v1::PredictActionDistributionsRequest(),
               asking(&Stub::PredictActionDistributions, v1::PredictActionDistributionsResponse())),
      all);
  EXPECT_THAT(names_of(v1::ClassifyTrajectoriesRequest(),
                       asking(&Stub::ClassifyTrajectories, v1::ClassifyTrajectoriesResponse())),
              all);
}

TEST_F(ServerTest, RefusesACallThatRequiresMissingNames) {
  Publish();
  v1::PredictRequest request = OneScene();
  request.add_required_action_names("action 1");
  v1::PredictResponse response;
  EXPECT_TRUE(Predict(request, &response).ok());
  request.add_required_action_names("left turn, tight");
  request.add_required_action_names("brake");
  request.add_required_action_names("brake");
  const grpc::Status gone = Predict(request, &response);
  EXPECT_EQ(gone.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(Reason(gone), "ACTION_NAME_GONE");
  EXPECT_THAT(gone.error_message(), HasSubstr("models/town/versions/1"));
  const v1::ErrorInfo info = InfoOf(gone);
  EXPECT_EQ(info.metadata().at("model_version"), "models/town/versions/1");
  EXPECT_EQ(info.metadata().at("action_name_0"), "brake");
  EXPECT_EQ(info.metadata().at("action_name_1"), "left turn, tight");
  EXPECT_EQ(info.metadata_size(), 3);
  // Errors travel in headers, which clients bound.
  request.add_required_action_names(std::string(257, 'x'));
  EXPECT_EQ(Predict(request, &response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  request.mutable_required_action_names()->RemoveLast();
  for (int i = 0; i < 100; ++i) request.add_required_action_names(absl::StrCat("name ", i));
  EXPECT_EQ(InfoOf(Predict(request, &response)).metadata_size(), 17);
}

TEST_F(ServerTest, RepresentativesComeWithTheirDistributionsFromEachMethod) {
  networks_.probabilities = Eigen::Vector3d(0.4, 0.25, 0.35);  // action 1 lies between the others
  Publish();
  v1::PredictRequest request = OneScene();
  request.mutable_query()->set_min_probability(1.0);
  request.mutable_query()->set_representatives(2);
  const auto check = [](const v1::TargetPrediction& target) {
    ASSERT_EQ(target.representatives_size(), 2);
    EXPECT_EQ(target.representatives(0).action_id(), 1);
    EXPECT_NEAR(target.representatives(0).weight(), 0.6, 1e-12);
    EXPECT_EQ(target.representatives(1).action_id(), 0);
    EXPECT_NEAR(target.representatives(1).weight(), 0.4, 1e-12);
    ASSERT_EQ(target.distributions_size(), 2);
    EXPECT_EQ(target.distributions(0).action_id(), 0);
    EXPECT_EQ(target.distributions(0).probability(), 0.4);
    EXPECT_EQ(target.distributions(1).action_id(), 1);
  };
  {
    v1::PredictResponse response;
    ASSERT_TRUE(Predict(request, &response).ok());
    check(response.predictions(0).targets(0));
  }
  {
    v1::PredictActionDistributionsRequest distributions;
    *distributions.add_scenarios() = Scene();
    *distributions.mutable_query() = request.query();
    v1::PredictActionDistributionsResponse response;
    grpc::ClientContext context;
    ASSERT_TRUE(stub_->PredictActionDistributions(&context, distributions, &response).ok());
    check(response.predictions(0).targets(0));
  }
  {
    grpc::ClientContext context;
    const auto stream = stub_->StreamPredict(&context);
    v1::StreamPredictRequest streamed;
    *streamed.mutable_request() = request;
    v1::StreamPredictResponse response;
    ASSERT_TRUE(stream->Write(streamed));
    ASSERT_TRUE(stream->Read(&response));
    check(response.response().predictions(0).targets(0));
    stream->WritesDone();
    EXPECT_TRUE(stream->Finish().ok());
  }
}

TEST_F(ServerTest, CombinationsComeWithTheirDistributionsFromEachMethod) {
  Publish();
  v1::PredictRequest request = OneScene();
  request.mutable_query()->set_top_k(1);
  request.mutable_query()->set_joint_combinations(2);
  const auto check = [](const v1::ScenarioPrediction& prediction) {
    const v1::JointPrediction& joint = prediction.joint();
    EXPECT_THAT(joint.target_ids(), ElementsAre(prediction.targets(0).target_id()));
    ASSERT_EQ(joint.combinations_size(), 2);
    EXPECT_THAT(joint.combinations(0).action_ids(), ElementsAre(1));
    EXPECT_THAT(joint.combinations(1).action_ids(), ElementsAre(2));
    EXPECT_NEAR(joint.combinations(0).log_probability(), std::log(0.5), 1e-12);
    EXPECT_NEAR(joint.combinations(0).weight(), 0.625, 1e-12);
    EXPECT_FALSE(joint.truncated());
    ASSERT_EQ(prediction.targets(0).distributions_size(), 2);
    EXPECT_EQ(prediction.targets(0).distributions(1).action_id(), 2);
  };
  {
    v1::PredictResponse response;
    ASSERT_TRUE(Predict(request, &response).ok());
    check(response.predictions(0));
  }
  {
    v1::PredictActionDistributionsRequest distributions;
    *distributions.add_scenarios() = Scene();
    *distributions.mutable_query() = request.query();
    v1::PredictActionDistributionsResponse response;
    grpc::ClientContext context;
    ASSERT_TRUE(stub_->PredictActionDistributions(&context, distributions, &response).ok());
    check(response.predictions(0));
  }
  {
    grpc::ClientContext context;
    const auto stream = stub_->StreamPredict(&context);
    v1::StreamPredictRequest streamed;
    *streamed.mutable_request() = request;
    v1::StreamPredictResponse response;
    ASSERT_TRUE(stream->Write(streamed));
    ASSERT_TRUE(stream->Read(&response));
    check(response.response().predictions(0));
    stream->WritesDone();
    EXPECT_TRUE(stream->Finish().ok());
  }
}

TEST_F(ServerTest, RefusesRequestsThatAreWrongAsAWhole) {
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
  request.mutable_query()->clear_action_ids();
  request.mutable_query()->set_representatives(4);  // of three actions
  const grpc::Status status = Predict(request, &response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_message(), HasSubstr("query.representatives: expected 0 to 3"));
}

TEST_F(ServerTest, LoadsTheRequestedVersionIfItIsNotInMemory) {
  Publish();
  Publish();
  v1::PredictRequest request = OneScene();
  request.set_model("models/town/versions/2");
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(request, &response).ok());
  EXPECT_EQ(response.model_version(), "models/town/versions/2");
}

TEST_F(ServerTest, TheShadowGetsARequestAfterItsCallerWasAnswered) {
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

TEST_F(ServerTest, RefusesAnUnknownPriority) {
  Publish();
  v1::PredictRequest request = OneScene();
  request.set_priority(static_cast<v1::Priority>(9));
  v1::PredictResponse response;
  EXPECT_EQ(Predict(request, &response).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
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

TEST_F(ServerTest, AScenarioWithAMalformedMapIdFailsAlone) {
  Publish();
  v1::PredictRequest request = OneScene();
  *request.add_scenarios() = Scene();
  request.mutable_scenarios(0)->set_map_id("../../etc/passwd");
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(request, &response).ok());
  EXPECT_THAT(response.predictions(0).error().message(), HasSubstr("scenarios[0].map_id"));
  EXPECT_EQ(response.predictions(1).targets_size(), 1);
}

TEST_F(ServerTest, RefusesCompressedRequests) {
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

TEST_F(ServerTest, CountsEveryCallByMethodAndCode) {
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

// gRPC's own messages are handed over by hand on the way to a method (guarded_service.cc): each way
// is gone once, for the leak checker's sake too.
TEST_F(ServerTest, AnswersRefusedEmptyAndMalformedCallsOfEachKind) {
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
  // Let in, but with bytes that are not a message, and with no message at all.
  for (const auto& to : {channel_, channel}) {
    grpc::ByteBuffer answer;
    const grpc::Status status =
        CallWithBytes(to, "/maneuver.v1.PredictionService/Predict", "\xff\xff\xff", &answer);
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

// Begins a call and sends nothing of its request. Returns how the server ends it.
grpc::Status PredictWithoutRequest(const std::shared_ptr<grpc::Channel>& channel) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  grpc::CompletionQueue queue;
  const auto finished = [&queue] {
    void* tag = nullptr;
    bool ok = false;
    queue.Next(&tag, &ok);
  };
  auto call = grpc::GenericStub(channel).PrepareCall(
      &context, "/maneuver.v1.PredictionService/Predict", &queue);
  call->StartCall(nullptr);
  finished();
  grpc::Status status;
  call->Finish(&status, nullptr);
  finished();
  return status;
}

// Otherwise a stranger could make the server receive any number of large messages.
TEST_F(ServerTest, RefusesAStrangerWhoHasNotSentTheRequest) {
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
  const grpc::Status status = PredictWithoutRequest(channel);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAUTHENTICATED) << status.error_message();
}

// Anybody may ask for the health and for reflection. Nobody has a token here.
TEST_F(ServerTest, EndsTheCallsOfAStrangerWhoSendsHalfOfLargeMessages) {
  for (const char* method : {"/grpc.health.v1.Health/Check", "/grpc.health.v1.Health/Watch",
                             "/grpc.reflection.v1.ServerReflection/ServerReflectionInfo"}) {
    maneuver::integration::RawHttp2 stranger(server_->address().ToString());
    stranger.SendPreface();
    stranger.SendSettings();
    for (int i = 0; i < 8; ++i) {
      stranger.OpenCall(2 * i + 1, method);
      stranger.BeginMessage(2 * i + 1, int64_t{60} << 20);
    }
    const auto give_up = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (stranger.begun() > 0 && std::chrono::steady_clock::now() < give_up) {
      stranger.Read(1, std::chrono::milliseconds(5), true);
      stranger.SendMore();
    }
    EXPECT_EQ(stranger.begun(), 0u) << method;
  }
  EXPECT_EQ(Health(""), 1);
}

TEST_F(ServerTest, RefusesALargeHealthCheck) {
  grpc::ByteBuffer answer;
  const std::string large(5'000, 's');
  EXPECT_EQ(CallWithBytes(channel_, "/grpc.health.v1.Health/Check", large, &answer).error_code(),
            grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(CallWithBytes(channel_, "/grpc.health.v1.Health/Watch", large, &answer).error_code(),
            grpc::StatusCode::RESOURCE_EXHAUSTED);
}

TEST_F(ServerTest, AHealthCheckOfAnUnknownServiceIsNotFound) {
  const auto stub = grpc::health::v1::Health::NewStub(channel_);
  grpc::ClientContext context;
  grpc::health::v1::HealthCheckRequest request;
  grpc::health::v1::HealthCheckResponse response;
  request.set_service("maneuver.v1.NoSuchService");
  const grpc::Status status = stub->Check(&context, request, &response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(status.error_message(), "service name unknown");
  grpc::ByteBuffer answer;
  EXPECT_EQ(
      CallWithBytes(channel_, "/grpc.health.v1.Health/Check", "\xff\xff", &answer).error_code(),
      grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(ServerTest, AWatchOfTheHealthIsToldEachChange) {
  const auto stub = grpc::health::v1::Health::NewStub(channel_);
  const auto watch = [&stub](grpc::ClientContext* context, const std::string& service) {
    grpc::health::v1::HealthCheckRequest request;
    request.set_service(service);
    return stub->Watch(context, request);
  };
  grpc::ClientContext predictions_context;
  const auto predictions = watch(&predictions_context, "maneuver.v1.PredictionService");
  grpc::ClientContext unknown_context;
  const auto unknown = watch(&unknown_context, "maneuver.v1.NoSuchService");
  using grpc::health::v1::HealthCheckResponse;
  HealthCheckResponse response;
  ASSERT_TRUE(unknown->Read(&response));
  EXPECT_EQ(response.status(), HealthCheckResponse::SERVICE_UNKNOWN);
  ASSERT_TRUE(predictions->Read(&response));
  EXPECT_EQ(response.status(), HealthCheckResponse::NOT_SERVING);
  Publish();
  ASSERT_TRUE(predictions->Read(&response));
  EXPECT_EQ(response.status(), HealthCheckResponse::SERVING);
  server_->TurnHealth();
  ASSERT_TRUE(predictions->Read(&response));
  EXPECT_EQ(response.status(), HealthCheckResponse::NOT_SERVING);
  server_->SetPredictionsReady(true);
  EXPECT_EQ(server_->IsServing("maneuver.v1.PredictionService"), false);
  server_->Shutdown(std::chrono::system_clock::now());
  EXPECT_FALSE(predictions->Read(&response)) << "the change before is permanent";
  EXPECT_FALSE(predictions->Finish().ok());
  EXPECT_FALSE(unknown->Finish().ok());
}

// One caller sends nothing of its request, by a connection with large ones, and the gate allows none.
TEST_F(ServerTest, ACallThatSendsItsRequestTooSlowlyIsRefusedAndAnotherIsAnswered) {
  Publish();
  MessageGate gate(1);
  const auto server = Server::Start({"127.0.0.1", 0},
                                    {{.name = v1::PredictionService::service_full_name(),
                                      .service = predictions_.get(),
                                      .gate = &gate}},
                                    *access_, *metrics_);
  ASSERT_TRUE(server.ok()) << server.status();
  std::jthread looking([&gate, port = (*server)->address().port](const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      auto large = ReceivedBytes(port).Recent();
      for (auto& [peer, bytes] : large) bytes += int64_t{1} << 30;
      gate.Weigh(large);
      gate.Look(std::chrono::steady_clock::now(), /*allowed=*/0);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  });
  const auto channel =
      grpc::CreateChannel((*server)->address().ToString(), grpc::InsecureChannelCredentials());
  for (int i = 0; i < 20; ++i) {
    const grpc::Status status = PredictWithoutRequest(channel);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED) << status.error_message();
    EXPECT_EQ(Reason(status), "MEMORY_FULL");
  }
  looking.request_stop();
  looking.join();
  gate.Look(std::chrono::steady_clock::now(), /*allowed=*/1);
  const auto stub = v1::PredictionService::NewStub(channel);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  v1::PredictResponse response;
  const grpc::Status answered = stub->Predict(&context, OneScene(), &response);
  EXPECT_TRUE(answered.ok()) << answered.error_message();
}

// Otherwise callers who fall silent within a request could keep it for ever.
TEST_F(ServerTest, RefusesARequestThatTakesTooLongToArrive) {
  ConnectionLimits limits;
  limits.request = std::chrono::seconds(1);
  const auto server = Server::Start(
      {"127.0.0.1", 0}, {{v1::PredictionService::service_full_name(), predictions_.get()}},
      *access_, *metrics_, nullptr, limits);
  ASSERT_TRUE(server.ok()) << server.status();
  const std::string address = (*server)->address().ToString();
  const grpc::Status status =
      PredictWithoutRequest(grpc::CreateChannel(address, grpc::InsecureChannelCredentials()));
  EXPECT_EQ(status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED) << status.error_message();
  EXPECT_EQ(Reason(status), "REQUEST_TOO_SLOW");
  for (const char* method : {"/maneuver.v1.PredictionService/Predict",
                             "/grpc.health.v1.Health/Check", "/grpc.health.v1.Health/Watch"}) {
    maneuver::integration::RawHttp2 slow(address);
    slow.SendPreface();
    slow.SendSettings();
    slow.OpenCall(1, method);
    slow.BeginMessage(1, 8);
    const auto give_up = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (slow.begun() > 0 && std::chrono::steady_clock::now() < give_up) {
      slow.Read(1, std::chrono::milliseconds(50), true);
    }
    EXPECT_EQ(slow.begun(), 0u) << method;
  }
}

// A server without room for calls, which only callers with a token reach.
TEST_F(ServerTest, WithoutRoomRefusesCallsOfEachKindButThoseThatRemoveSomething) {
  Publish();
  ASSERT_TRUE(
      security::AppendLine(
          folder_ / "tokens",
          *security::TokenLine("ada", *security::RoleSet::Parse("predict,train,admin"), "secret"))
          .ok());
  const auto access =
      security::AccessControl::Create({.identities = folder_ / "tokens"}, *metrics_);
  ASSERT_TRUE(access.ok()) << access.status();
  std::atomic<int> asked = 0;
  const auto room = [&asked](int64_t) -> absl::StatusOr<std::shared_ptr<const void>> {
    ++asked;
    return errors::WithReason(absl::ResourceExhaustedError("full"), "MEMORY_FULL");
  };
  const auto full =
      Server::Start({"127.0.0.1", 0},
                    {{v1::PredictionService::service_full_name(), predictions_.get(), {}, {}, room},
                     {v1::ModelService::service_full_name(), model_service_.get(), {}, {}, room}},
                    **access, *metrics_);
  ASSERT_TRUE(full.ok()) << full.status();
  const auto channel =
      grpc::CreateChannel((*full)->address().ToString(), grpc::InsecureChannelCredentials());
  // A stranger does not learn that the server is full.
  grpc::ByteBuffer answer;
  EXPECT_EQ(
      CallWithBytes(channel, "/maneuver.v1.PredictionService/Predict", "", &answer).error_code(),
      grpc::StatusCode::UNAUTHENTICATED);
  EXPECT_EQ(asked, 0);

  const auto status_of = [&](const char* method) {
    grpc::ClientContext context;
    context.AddMetadata("authorization", "Bearer secret");
    grpc::CompletionQueue queue;
    const auto finished = [&queue] {
      void* tag = nullptr;
      bool ok = false;
      queue.Next(&tag, &ok);
    };
    auto call = grpc::GenericStub(channel).PrepareCall(
        &context, absl::StrCat("/maneuver.v1.", method), &queue);
    call->StartCall(nullptr);
    finished();
    const grpc::Slice empty;
    call->WriteLast(grpc::ByteBuffer(&empty, 1), grpc::WriteOptions(), nullptr);
    finished();
    grpc::Status status;
    call->Finish(&status, nullptr);
    finished();
    return status;
  };
  for (const char* method :
       {"PredictionService/Predict", "PredictionService/StreamPredict",
        "PredictionService/RegisterMap", "ModelService/ListModelVersions",
        "ModelService/DownloadModelVersion", "ModelService/UploadModelVersion"}) {
    EXPECT_EQ(Reason(status_of(method)), "MEMORY_FULL") << method;
  }
  EXPECT_EQ(asked, 6);
  for (const char* method : {"ModelService/DeleteModelVersion", "ModelService/DeleteModelAlias"}) {
    EXPECT_EQ(status_of(method).error_code(), grpc::StatusCode::INVALID_ARGUMENT) << method;
  }
  EXPECT_EQ(asked, 6);
}

// Anybody may ask, without a token.
TEST_F(ServerTest, BoundsWhatCallersOfReflectionHold) {
  const auto stub = grpc::reflection::v1::ServerReflection::NewStub(channel_);
  struct Call {
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReaderWriter<grpc::reflection::v1::ServerReflectionRequest,
                                             grpc::reflection::v1::ServerReflectionResponse>>
        stream;
  };
  const auto open = [&stub](size_t bytes) {
    auto call = std::make_unique<Call>();
    call->stream = stub->ServerReflectionInfo(&call->context);
    grpc::reflection::v1::ServerReflectionRequest request;
    request.set_list_services("");
    request.set_host(std::string(bytes, 'h'));
    call->stream->Write(request);
    return call;
  };
  grpc::reflection::v1::ServerReflectionResponse response;
  auto large = open(2000);
  EXPECT_FALSE(large->stream->Read(&response));
  EXPECT_EQ(large->stream->Finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);

  std::vector<std::unique_ptr<Call>> calls;
  while (calls.size() < 64) {
    calls.push_back(open(10));
    // The large one may not have ended yet.
    if (!calls.back()->stream->Read(&response)) calls.pop_back();
  }
  auto refused = open(10);
  EXPECT_FALSE(refused->stream->Read(&response));
  EXPECT_EQ(refused->stream->Finish().error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  calls.clear();  // cancels them
}

// gRPC keeps such a request as long as the call.
TEST_F(ServerTest, RefusesALargeRequestOfAMethodThatAnswersWithAStream) {
  Publish();
  v1::DownloadModelVersionRequest request;
  request.set_name(std::string(65'536, 'a'));
  grpc::ClientContext context;
  v1::DownloadModelVersionResponse response;
  const auto stream = model_stub_->DownloadModelVersion(&context, request);
  EXPECT_FALSE(stream->Read(&response));
  const grpc::Status status = stream->Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_message(), HasSubstr("64 KiB"));
}

TEST_F(ServerTest, AnInvalidAnswerFailsOnlyItsTarget) {
  Publish();
  networks_.ahead = std::numeric_limits<double>::infinity();
  v1::PredictRequest request = OneScene();
  request.mutable_scenarios(0)->add_target_ids(8);
  *request.mutable_scenarios(0)->add_agents() = request.scenarios(0).agents(0);
  request.mutable_scenarios(0)->mutable_agents(1)->set_id(8);
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(request, &response).ok());
  const v1::TargetPrediction& target = response.predictions(0).targets(1);
  EXPECT_EQ(target.error().code(), 13);
  EXPECT_THAT(target.error().message(), ::testing::StartsWith("scenarios[0].target_ids[1]: "));
  EXPECT_EQ(target.distributions_size(), 0);
}

// Actions that only a combination names are described later than the others.
TEST_F(ServerTest, AnInvalidActionOfACombinationFailsItsTarget) {
  Publish();
  networks_.unsound_action = 2;
  v1::PredictRequest request = OneScene();
  request.mutable_query()->set_top_k(1);
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(request, &response).ok());
  EXPECT_FALSE(response.predictions(0).targets(0).has_error());
  request.mutable_query()->set_joint_combinations(2);
  ASSERT_TRUE(Predict(request, &response).ok());
  EXPECT_EQ(response.predictions(0).targets(0).error().code(), 13);
  EXPECT_EQ(response.predictions(0).targets(0).distributions_size(), 0);
}

TEST_F(ServerTest, ATakenPortIsAnError) {
  const auto second = Server::Start(
      server_->address(), {{v1::PredictionService::service_full_name(), predictions_.get()}},
      *access_, *metrics_);
  EXPECT_TRUE(absl::IsUnavailable(second.status()));
}

TEST_F(ServerTest, RefusesARequestWhoseAnswerCouldBeTooLarge) {
  Publish();
  const int described = networks_.described();  // to warm up
  v1::PredictRequest request;
  for (int i = 0; i < 50; ++i) {
    v1::Scenario& scenario = *request.add_scenarios();
    scenario = Scene();
    // None of these is an agent, but each would have an error as its answer.
    for (int id = 100; id < 150; ++id) scenario.add_target_ids(id);
  }
  request.mutable_query()->set_min_probability(0.0);
  v1::PredictResponse response;
  const grpc::Status status = Predict(request, &response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(Reason(status), "RESPONSE_TOO_LARGE");
  EXPECT_THAT(status.error_message(), ::testing::HasSubstr("omit_sigma_trajectories"));
  EXPECT_EQ(networks_.described(), described);
  request.mutable_scenarios()->DeleteSubrange(10, 40);
  EXPECT_TRUE(Predict(request, &response).ok());
}

TEST_F(ServerTest, AnAnswerReleasesItsMemoryOnceItIsRead) {
  Publish();
  v1::PredictResponse response;
  for (int i = 0; i < 100; ++i) ASSERT_TRUE(Predict(OneScene(), &response).ok());
  // The end of a call is seen by its caller before it is by the server.
  while (SendMemory() > 0.0) std::this_thread::yield();
}

// One connection that asks for some megabytes, more than the kernel keeps for it, and never reads.
TEST_F(ServerTest, ShutsDownInTimeEvenIfACallerDoesNotRead) {
  Publish();
  constexpr int kKept = 4096;
  maneuver::integration::RawHttp2 reader(server_->address().ToString(), kKept);
  reader.SendPreface();
  reader.SendSettingsWithoutFlowControl();
  v1::PredictRequest request = OneScene();
  v1::Scenario& scenario = *request.mutable_scenarios(0);
  for (int64_t id = 1000; id < 1500; ++id) scenario.add_target_ids(id);
  constexpr int kCalls = 60;
  for (int i = 0; i < kCalls; ++i) {
    reader.OpenCall(2 * i + 1, "/maneuver.v1.PredictionService/Predict");
    reader.SendMessage(2 * i + 1, request.SerializeAsString());
  }
  while (SendMemory() < 2e6) std::this_thread::yield();
  const auto start = std::chrono::steady_clock::now();
  server_->Shutdown(std::chrono::system_clock::now() + std::chrono::milliseconds(200));
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(5));
}

TEST_F(ServerTest, ClosesConnectionsIfThereAreTooManyAndAnswersOnTheOthers) {
  Publish();
  const auto server = Server::Start(
      {"127.0.0.1", 0}, {{v1::PredictionService::service_full_name(), predictions_.get()}},
      *access_, *metrics_, nullptr, {.max_connections = 2});
  ASSERT_TRUE(server.ok()) << server.status();
  std::list<integration::RawHttp2> connections;
  for (int i = 0; i < 5; ++i) {
    connections.emplace_back((*server)->address().ToString());
    connections.back().SendPreface();
    connections.back().SendSettings();
  }
  int closed = 0;
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (closed < 3 && std::chrono::steady_clock::now() < end) {
    closed += static_cast<int>(std::erase_if(connections, [](integration::RawHttp2& connection) {
      return connection.Read(1, std::chrono::milliseconds(50), true).closed;
    }));
  }
  EXPECT_EQ(closed, 3);
  integration::RawHttp2& left = connections.front();
  left.OpenCall(1, "/maneuver.v1.PredictionService/Predict");
  left.SendMessage(1, OneScene().SerializeAsString());
  EXPECT_EQ(left.Read(1, std::chrono::seconds(20), true).messages, 1);
}

TEST_F(ServerTest, ClosesAConnectionWithTooManyCalls) {
  Publish();
  const auto server = Server::Start(
      {"127.0.0.1", 0}, {{v1::PredictionService::service_full_name(), predictions_.get()}},
      *access_, *metrics_, nullptr, {.max_streams = 2});
  ASSERT_TRUE(server.ok()) << server.status();
  integration::RawHttp2 caller((*server)->address().ToString());
  caller.SendPreface();
  caller.SendSettings();
  // The limit holds once the peer has acknowledged the server's settings, as Read does.
  caller.OpenCall(1, "/maneuver.v1.PredictionService/Predict");
  caller.SendMessage(1, OneScene().SerializeAsString());
  ASSERT_EQ(caller.Read(1, std::chrono::seconds(20), true).messages, 1);
  for (const int stream : {3, 5, 7}) {
    caller.OpenCall(stream, "/maneuver.v1.PredictionService/Predict");
  }
  EXPECT_TRUE(caller.Read(1, std::chrono::seconds(20), true).closed);
}

// Such a peer may open any number of calls, as far as gRPC is concerned.
TEST_F(ServerTest, ClosesAConnectionWithFarTooManyCallsWhosePeerAcknowledgesNoSettings) {
  Publish();
  const auto server = Server::Start(
      {"127.0.0.1", 0}, {{v1::PredictionService::service_full_name(), predictions_.get()}},
      *access_, *metrics_, nullptr, {.max_streams = 2});
  ASSERT_TRUE(server.ok()) << server.status();
  integration::RawHttp2 many((*server)->address().ToString());
  integration::RawHttp2 some((*server)->address().ToString());
  for (integration::RawHttp2* caller : {&many, &some}) {
    caller->SendPreface();
    caller->SendSettings();
    for (int call = 0; call < 4; ++call) {
      caller->OpenCall(2 * call + 1, "/maneuver.v1.PredictionService/Predict");
    }
  }
  many.OpenCall(9, "/maneuver.v1.PredictionService/Predict");
  EXPECT_TRUE(many.Read(1, std::chrono::seconds(20), false).closed);
  some.SendMessage(1, OneScene().SerializeAsString());
  EXPECT_EQ(some.Read(1, std::chrono::seconds(20), true).messages, 1);
}

// A client of gRPC says 27,000 hours at most, three years.
TEST_F(ServerTest, AcceptsADeadlineCenturiesAhead) {
  Publish();
  integration::RawHttp2 caller(server_->address().ToString());
  caller.SendPreface();
  caller.SendSettings();
  int stream = 1;
  for (const char* timeout : {"2562047H", "99999999H"}) {
    caller.OpenCall(stream, "/maneuver.v1.PredictionService/Predict", 0, timeout);
    caller.SendMessage(stream, OneScene().SerializeAsString());
    EXPECT_EQ(caller.Read(1, std::chrono::seconds(20), true).messages, 1) << timeout;
    stream += 2;
  }
}

TEST_F(ServerTest, RefusesCallsAndStreamsOfEmptyElementsBeforeTheyAreParsed) {
  Publish();
  v1::StreamPredictRequest streamed;
  v1::PredictRequest& request = *streamed.mutable_request();
  request = OneScene();
  for (int i = 0; i < 600'000; ++i) request.add_required_action_names();
  const auto check = [](const std::string& message) {
    EXPECT_THAT(message, HasSubstr("leave out empty elements"));
  };
  {
    grpc::ClientContext context;
    v1::PredictResponse response;
    check(stub_->Predict(&context, request, &response).error_message());
  }
  grpc::ClientContext context;
  const auto stream = stub_->StreamPredict(&context);
  v1::StreamPredictResponse response;
  ASSERT_TRUE(stream->Write(streamed));
  ASSERT_TRUE(stream->Read(&response));
  check(response.error().message());
  stream->WritesDone();
  EXPECT_TRUE(stream->Finish().ok());
}

// gRPC 1.51 sends no GOAWAY then: it ends every call of the connection with a status, and closes
// it.
TEST_F(ServerTest, HeadersOverTheLimitEndTheConnectionWithAClearStatus) {
  Publish();
  maneuver::integration::RawHttp2 caller(server_->address().ToString());
  caller.SendPreface();
  caller.SendSettings();
  // The limit holds once the peer has acknowledged the server's settings, as Read does.
  caller.OpenCall(1, "/maneuver.v1.PredictionService/Predict");
  caller.SendMessage(1, OneScene().SerializeAsString());
  ASSERT_EQ(caller.Read(1, std::chrono::seconds(20), true).messages, 1);
  caller.OpenCall(3, "/maneuver.v1.PredictionService/Predict", 90);
  const auto received = caller.Read(1, std::chrono::seconds(20), true);
  EXPECT_TRUE(received.closed);
  EXPECT_THAT(received.headers, ::testing::HasSubstr(std::string("grpc-status\x01") + "8"));
  EXPECT_THAT(received.headers,
              ::testing::HasSubstr("received initial metadata size exceeds limit"));

  // A client of gRPC knows the limit, and refuses by itself.
  grpc::ClientContext context;
  context.AddMetadata("x-filling", std::string(9'000, 'f'));
  v1::PredictResponse response;
  const grpc::Status status = stub_->Predict(&context, OneScene(), &response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_THAT(status.error_message(), ::testing::HasSubstr("metadata size exceeds"));
}

// Clients of later releases look for this code, and do without the method.
TEST_F(ServerTest, SaysThatItHasNoSuchMethod) {
  for (const char* method : {"/maneuver.v1.PredictionService/Guess", "/other.Service/Predict"}) {
    grpc::ByteBuffer answer;
    const grpc::Status status =
        CallWithBytes(channel_, method, OneScene().SerializeAsString(), &answer);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::UNIMPLEMENTED) << status.error_message();
    EXPECT_EQ(status.error_message(), "this server has no such method");
  }
  Health("");
  server_->Shutdown(std::chrono::system_clock::now() + std::chrono::seconds(10));
  const std::string page = metrics_->Page();
  EXPECT_THAT(page,
              HasSubstr("maneuver_requests_total{code=\"UNIMPLEMENTED\",method=\"unknown\"} 2"));
  EXPECT_THAT(page, HasSubstr("maneuver_requests_total{code=\"OK\",method=\"Health/Check\"} 1"));
  EXPECT_THAT(page, ::testing::Not(HasSubstr("Guess"))) << "any name would take memory for ever";
}

TEST_F(ServerTest, RefusesBytesThatAreNotAMessage) {
  Publish();
  const std::string no_utf8("\x0a\x02\xff\xfe", 4);  // in PredictRequest.model
  for (const std::string& bytes : {std::string("\xff\xff\xff"), no_utf8}) {
    for (const char* method : {"PredictionService/Predict", "ModelService/GetModelVersion"}) {
      grpc::ByteBuffer answer;
      const grpc::Status status =
          CallWithBytes(channel_, std::string("/maneuver.v1.") + method, bytes, &answer);
      EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << method;
      EXPECT_EQ(Reason(status), "MALFORMED_MESSAGE") << method;
    }
  }
  v1::PredictResponse response;
  EXPECT_TRUE(Predict(OneScene(), &response).ok());
}

}  // namespace
}  // namespace maneuver::rpc::server_test
