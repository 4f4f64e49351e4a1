// What callers cannot take from a server: its memory, its connections, its time.

#include <gmock/gmock.h>

#include <atomic>
#include <chrono>
#include <list>
#include <stop_token>
#include <thread>

#include "absl/strings/str_cat.h"
#include "grpc/reflection/v1/reflection.grpc.pb.h"
#include "server/errors/error_details.h"
#include "server/rpc/message_gate.h"
#include "server/rpc/open_connections.h"
#include "server/rpc/predict_stream.h"
#include "server/security/identities.h"
#include "server/security/secret_file.h"
#include "tests/integration/raw_http2.h"
#include "tests/unit/server/rpc/server_fixture.h"

namespace maneuver::rpc::server_limits_test {
namespace {

using ::testing::HasSubstr;

// Waits for what a call began last.
void WaitForOne(grpc::CompletionQueue& queue) {
  void* tag = nullptr;
  bool ok = false;
  queue.Next(&tag, &ok);
}

// Begins a call and sends nothing of its request. Returns how the server ends it.
grpc::Status PredictWithoutRequest(const std::shared_ptr<grpc::Channel>& channel) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  grpc::CompletionQueue queue;
  auto call = grpc::GenericStub(channel).PrepareCall(
      &context, "/maneuver.v1.PredictionService/Predict", &queue);
  call->StartCall(nullptr);
  WaitForOne(queue);
  grpc::Status status;
  call->Finish(&status, nullptr);
  WaitForOne(queue);
  return status;
}

// Otherwise a stranger could make the server receive any number of large messages.
TEST_F(ServerTest, RefusesAStrangerWhoHasNotSentTheRequest) {
  StartClosed();
  ASSERT_NE(closed_, nullptr);
  const auto channel =
      grpc::CreateChannel(closed_->address().ToString(), grpc::InsecureChannelCredentials());
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

// One caller sends nothing of its request, by a connection with large ones, and the gate allows none.
TEST_F(ServerTest, ACallThatSendsItsRequestTooSlowlyIsRefusedAndAnotherIsAnswered) {
  Publish();
  MessageGate gate(1);
  const auto server = Server::Start({"127.0.0.1", 0},
                                    {{.name = v1::PredictionService::service_full_name(),
                                      .service = predictions_.get(),
                                      .message_gate = &gate}},
                                    *access_, *metrics_);
  ASSERT_TRUE(server.ok()) << server.status();
  std::jthread looking([&gate, port = (*server)->address().port](const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      auto large = ReceivedBytes(port).Recent();
      for (auto& [peer, bytes] : large) bytes += int64_t{1} << 30;
      gate.Weigh(large);
      gate.StopExcess(std::chrono::steady_clock::now(), /*allowed=*/0);
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
  gate.StopExcess(std::chrono::steady_clock::now(), /*allowed=*/1);
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
  const auto full = Server::Start({"127.0.0.1", 0},
                                  {{.name = v1::PredictionService::service_full_name(),
                                    .service = predictions_.get(),
                                    .reserve_memory = room},
                                   {.name = v1::ModelService::service_full_name(),
                                    .service = model_service_.get(),
                                    .reserve_memory = room}},
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
    auto call = grpc::GenericStub(channel).PrepareCall(
        &context, absl::StrCat("/maneuver.v1.", method), &queue);
    call->StartCall(nullptr);
    WaitForOne(queue);
    const grpc::Slice empty;
    call->WriteLast(grpc::ByteBuffer(&empty, 1), grpc::WriteOptions(), nullptr);
    WaitForOne(queue);
    grpc::Status status;
    call->Finish(&status, nullptr);
    WaitForOne(queue);
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

// Parsed, a message full of small fields that nobody knows takes many times its bytes.
TEST_F(ServerTest, LooksAtTheSizeOfAReflectionRequestBeforeItParsesIt) {
  for (const std::string version : {"v1", "v1alpha"}) {
    grpc::ByteBuffer answer;
    const std::string method =
        absl::StrCat("/grpc.reflection.", version, ".ServerReflection/ServerReflectionInfo");
    const std::string no_message(1025, '\xff');
    const grpc::Status large = CallWithBytes(channel_, method, no_message, &answer);
    EXPECT_EQ(large.error_message(), "a reflection request has at most 1024 bytes");
    const grpc::Status small = CallWithBytes(channel_, method, "\xff\xff\xff", &answer);
    EXPECT_EQ(small.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    EXPECT_THAT(small.error_message(), HasSubstr("do not parse"));
  }
}

// gRPC keeps such a request as long as the call.
TEST_F(ServerTest, RefusesALargeRequestOfAMethodThatAnswersWithAStream) {
  Publish();
  v1::DownloadModelVersionRequest request;
  request.set_name(std::string(1 << 20, 'a'));
  grpc::ClientContext context;
  v1::DownloadModelVersionResponse response;
  const auto stream = model_stub_->DownloadModelVersion(&context, request);
  EXPECT_FALSE(stream->Read(&response));
  const grpc::Status status = stream->Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_THAT(status.error_message(), HasSubstr("at most 1 MiB"));
}

// The tags of 10,000 shards have two files for each, and a schema.
TEST_F(ServerTest, ContinuesADownloadOfAsManyFilesAsTagsHave) {
  Publish();
  v1::DownloadModelVersionRequest request;
  request.set_name("models/town/versions/1");
  for (int i = 0; i < 20'001; ++i) request.add_arrived_bytes(int64_t{1} << 40);
  grpc::ClientContext context;
  v1::DownloadModelVersionResponse response;
  const auto stream = model_stub_->DownloadModelVersion(&context, request);
  EXPECT_FALSE(stream->Read(&response));
  // So far it got: this model has no files.
  EXPECT_THAT(stream->Finish().error_message(), HasSubstr("model.json is missing"));
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

TEST_F(ServerTest, DoesNotEchoAnIdThatNoSceneMayHave) {
  Publish();
  v1::PredictRequest request = OneScene();
  request.mutable_scenarios(0)->set_scenario_id(std::string(2 << 20, 'x'));
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(request, &response).ok());
  EXPECT_EQ(response.predictions(0).error().code(), 3);
  EXPECT_LT(response.ByteSizeLong(), 4096u);
}

TEST_F(ServerTest, ARequestThatFailsKeepsNoMemoryForItsAnswer) {
  Publish();
  const v1::PredictRequest request = OneScene();
  v1::PredictResponse response;
  absl::Status end;
  const auto past = std::chrono::steady_clock::now() - std::chrono::seconds(1);
  const auto run = PredictionRun::Start(*context_, PredictIo(request, &response), past, nullptr,
                                        [&end](absl::Status status) { end = std::move(status); });
  EXPECT_TRUE(absl::IsDeadlineExceeded(end)) << end;
  EXPECT_GT(run->answer_bytes(), 0);  // what was reserved
  EXPECT_EQ(SendMemory(), 0.0);
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

}  // namespace
}  // namespace maneuver::rpc::server_limits_test
