#include "server/rpc/server.h"

#include <gmock/gmock.h>

#include <future>
#include <latch>
#include <limits>

#include "absl/strings/str_cat.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "server/rpc/predict_stream.h"
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
  server_->ShowNotServing();
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

TEST_F(ServerTest, WhileVersionsAreLoadedOtherCallsAreAnswered) {
  Publish();
  Publish();
  v1::PredictRequest request = OneScene();
  request.set_model("models/town/versions/2");
  networks_.CloseGate();  // before a version serves it answers an empty scene
  constexpr int kMoreThanThreads = 3;
  std::vector<v1::PredictResponse> responses(kMoreThanThreads);
  std::latch finished(kMoreThanThreads);
  for (v1::PredictResponse& response : responses) {
    PredictionRun::Start(*context_, PredictIo(request, &response), serving::TimePoint::max(),
                         /*request=*/nullptr, [&](const absl::Status& status) {
                           EXPECT_TRUE(status.ok()) << status;
                           finished.count_down();
                         });
  }
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(30));
  v1::ListModelVersionsRequest list;
  list.set_parent("models/town");
  v1::ListModelVersionsResponse versions;
  const grpc::Status status = model_stub_->ListModelVersions(&context, list, &versions);
  EXPECT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(versions.model_versions_size(), 2);
  networks_.OpenGate();
  finished.wait();
}

TEST_F(ServerTest, WhileTooMuchWaitsForTheDiskADeletionIsAcceptedNevertheless) {
  constexpr int kThreads = 2;
  std::latch busy(kThreads);
  std::latch released(1);
  for (int i = 0; i < kThreads; ++i) {
    ASSERT_TRUE(disk_->Post([&] {
      busy.count_down();
      released.wait();
    }));
  }
  busy.wait();
  while (disk_->Post([] {})) {
  }
  {
    grpc::ClientContext context;
    v1::ListModelVersionsRequest request;
    request.set_parent("models/town");
    v1::ListModelVersionsResponse response;
    EXPECT_EQ(Reason(model_stub_->ListModelVersions(&context, request, &response)),
              "TOO_MANY_REQUESTS");
  }
  auto deletion = std::async(std::launch::async, [this] {
    grpc::ClientContext context;
    v1::DeleteModelVersionRequest request;
    request.set_name("models/town/versions/1");
    google::protobuf::Empty response;
    return model_stub_->DeleteModelVersion(&context, request, &response);
  });
  EXPECT_EQ(deletion.wait_for(std::chrono::milliseconds(100)), std::future_status::timeout);
  released.count_down();
  EXPECT_EQ(deletion.get().error_code(), grpc::StatusCode::NOT_FOUND);
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
  StartClosed();
  ASSERT_NE(closed_, nullptr);
  const auto channel =
      grpc::CreateChannel(closed_->address().ToString(), grpc::InsecureChannelCredentials());
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
  server_->ShowNotServing();
  ASSERT_TRUE(predictions->Read(&response));
  EXPECT_EQ(response.status(), HealthCheckResponse::NOT_SERVING);
  server_->SetPredictionsReady(true);
  EXPECT_EQ(server_->IsServing("maneuver.v1.PredictionService"), false);
  server_->Shutdown(std::chrono::system_clock::now());
  EXPECT_FALSE(predictions->Read(&response)) << "the change before is permanent";
  EXPECT_FALSE(predictions->Finish().ok());
  EXPECT_FALSE(unknown->Finish().ok());
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
  const auto counted = [this](const std::string& outcome) {
    const std::string page = metrics_->Page();
    const std::string name = "maneuver_targets_total{outcome=\"" + outcome + "\"} ";
    return std::stod(page.substr(page.find(name) + name.size()));
  };
  networks_.unsound_action = 2;
  v1::PredictRequest request = OneScene();
  request.mutable_query()->set_top_k(1);
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(request, &response).ok());
  EXPECT_FALSE(response.predictions(0).targets(0).has_error());
  EXPECT_EQ(counted("answered"), 1.0);
  request.mutable_query()->set_joint_combinations(2);
  ASSERT_TRUE(Predict(request, &response).ok());
  EXPECT_EQ(response.predictions(0).targets(0).error().code(), 13);
  EXPECT_EQ(counted("answered"), 1.0);
  EXPECT_EQ(counted("unsound"), 1.0);
  EXPECT_EQ(response.predictions(0).targets(0).distributions_size(), 0);
}

TEST_F(ServerTest, ATakenPortIsAnError) {
  const auto second = Server::Start(
      server_->address(), {{v1::PredictionService::service_full_name(), predictions_.get()}},
      *access_, *metrics_);
  EXPECT_TRUE(absl::IsUnavailable(second.status()));
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
