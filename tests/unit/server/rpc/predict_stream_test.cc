#include "server/rpc/predict_stream.h"

#include <gmock/gmock.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "server/errors/error_details.h"
#include "tests/unit/server/rpc/server_fixture.h"

namespace maneuver::rpc::predict_stream_test {
namespace {

class PredictStreamTest : public ServerTest {
 protected:
  // A caller who holds few answers that it has not read.
  std::unique_ptr<v1::PredictionService::Stub> SlowReader() const {
    grpc::ChannelArguments small_windows;
    small_windows.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
    return v1::PredictionService::NewStub(grpc::CreateCustomChannel(
        server_->address().ToString(), grpc::InsecureChannelCredentials(), small_windows));
  }
};

// Returns a StreamPredictRequest whose `request` field cannot be parsed.
std::string Unparseable(int timeout_nanos) {
  v1::StreamPredictRequest request;
  request.set_request_id("unparseable");
  if (timeout_nanos > 0) request.mutable_timeout()->set_nanos(timeout_nanos);
  return request.SerializeAsString() + "\x12\x03\xff\xff\xff";
}

TEST_F(PredictStreamTest, AStreamAnswersRequestsAsTheyFinish) {
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

TEST_F(PredictStreamTest, RefusesATimeoutThatIsNoDuration) {
  Publish();
  grpc::ClientContext context;
  auto stream = stub_->StreamPredict(&context);
  v1::StreamPredictRequest request;
  *request.mutable_request() = OneScene();
  v1::StreamPredictResponse response;
  const std::pair<int64_t, int32_t> wrong[] = {
      {5, -1}, {-5, 1}, {0, 1'000'000'000}, {0, -1'000'000'000}};
  for (const auto& [seconds, nanos] : wrong) {
    request.mutable_timeout()->set_seconds(seconds);
    request.mutable_timeout()->set_nanos(nanos);
    ASSERT_TRUE(stream->Write(request));
    ASSERT_TRUE(stream->Read(&response));
    EXPECT_EQ(response.error().code(), grpc::StatusCode::INVALID_ARGUMENT) << seconds << nanos;
    EXPECT_THAT(response.error().message(), testing::HasSubstr("timeout"));
  }
  request.mutable_timeout()->set_seconds(60);
  request.mutable_timeout()->set_nanos(999'999'999);
  ASSERT_TRUE(stream->Write(request));
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_TRUE(response.has_response()) << response.error().message();
  EXPECT_TRUE(stream->WritesDone());
  EXPECT_TRUE(stream->Finish().ok());
}

TEST_F(PredictStreamTest, RefusesATooCloseDeadlineBeforeParsingTheRequest) {
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
    EXPECT_EQ(response.request_id(), "unparseable");
    return errors::FromProto(response.error());
  };
  constexpr int kMillisecond = 1'000'000;
  EXPECT_EQ(errors::ReasonOf(ask(Unparseable(100 * kMillisecond))), "MALFORMED_MESSAGE");

  // Both workers are busy and other requests wait.
  networks_.CloseGate();
  grpc::ClientContext waiting_context;
  const auto waiting = stub_->StreamPredict(&waiting_context);
  v1::StreamPredictRequest request;
  *request.mutable_request() = OneScene();
  const size_t warm_up = networks_.batches().size();
  for (int i = 0; i < 60; ++i) ASSERT_TRUE(waiting->Write(request));
  networks_.AwaitBatches(warm_up + 2);
  EXPECT_EQ(ask(Unparseable(kMillisecond)).code(), absl::StatusCode::kResourceExhausted);
  // Without a deadline.
  EXPECT_EQ(errors::ReasonOf(ask(Unparseable(0))), "MALFORMED_MESSAGE");
  networks_.OpenGate();
  waiting_context.TryCancel();
  waiting->Finish();
  context.TryCancel();
  grpc::Status status;
  stream->Finish(&status, nullptr);
  finished();
}

TEST_F(PredictStreamTest, AStreamAcceptsAnyNumberOfRequests) {
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

TEST_F(PredictStreamTest, WorkStopsWhenTheCallerLeaves) {
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

TEST_F(PredictStreamTest, IdleStreamsDoNotDelayTheShutdown) {
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

TEST_F(PredictStreamTest, AStreamOpenedAfterTheDrainEndsAtOnce) {
  predictions_->Drain();
  grpc::ClientContext context;
  const auto stream = stub_->StreamPredict(&context);
  v1::StreamPredictResponse response;
  EXPECT_FALSE(stream->Read(&response));
  EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::UNAVAILABLE);
}

// More than the windows of HTTP/2 let through, as long as they do not grow.
TEST_F(PredictStreamTest, UnreadAnswersCountAsMemoryUntilTheyAreRead) {
  Publish();
  const auto stub = SlowReader();
  grpc::ClientContext context;
  auto stream = stub->StreamPredict(&context);
  v1::StreamPredictRequest request;
  *request.mutable_request() = OneScene();
  for (int64_t id = 1000; id < 1500; ++id) {
    request.mutable_request()->mutable_scenarios(0)->add_target_ids(id);
  }
  constexpr int kRequests = 30;
  for (int i = 0; i < kRequests; ++i) ASSERT_TRUE(stream->Write(request));
  ASSERT_TRUE(stream->WritesDone());
  // Until nearly all are answered, and some could not be sent.
  while (SendMemory() < 2e6) std::this_thread::yield();
  v1::StreamPredictResponse response;
  int answers = 0;
  while (stream->Read(&response)) ++answers;
  EXPECT_EQ(answers, kRequests);
  EXPECT_TRUE(stream->Finish().ok());
  while (SendMemory() > 0.0) std::this_thread::yield();
}

TEST_F(PredictStreamTest, AStreamReadsNoMoreRequestsWhileItsAnswersAreNotTaken) {
  Publish();
  const auto stub = SlowReader();
  grpc::ClientContext context;
  auto stream = stub->StreamPredict(&context);
  v1::StreamPredictRequest request;
  *request.mutable_request() = OneScene();
  v1::Scenario& scene = *request.mutable_request()->mutable_scenarios(0);
  for (int64_t id = 1000; id < 1500; ++id) scene.add_target_ids(id);  // each has an error
  v1::MapFeature& lane = *scene.add_map_features();  // so that few requests fill HTTP/2's windows
  lane.set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  for (int i = 0; i < 8000; ++i) {
    lane.add_x(1e4 + i);
    lane.add_y(0.0);
  }
  constexpr int kRequests = 800;
  std::atomic<int> written = 0;
  std::thread writer([&] {
    while (written < kRequests && stream->Write(request)) ++written;
    stream->WritesDone();
  });
  int before = 0;
  while (written == 0 || written != before) {
    before = written;
    std::this_thread::sleep_for(std::chrono::seconds(1));
  }
  EXPECT_LT(before, kRequests / 2);  // 64 that were read, and 8 MB in the windows
  v1::StreamPredictResponse response;
  int answers = 0;
  while (stream->Read(&response)) ++answers;
  writer.join();
  EXPECT_EQ(answers, kRequests);
  EXPECT_TRUE(stream->Finish().ok());
}

TEST_F(PredictStreamTest, RefusesAnIdThatIsNotUtf8WithoutEchoingIt) {
  Publish();
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  const auto done = [&queue] {
    void* tag = nullptr;
    bool ok = false;
    queue.Next(&tag, &ok);
    return ok;
  };
  auto stream = grpc::GenericStub(channel_).PrepareCall(
      &context, "/maneuver.v1.PredictionService/StreamPredict", &queue);
  stream->StartCall(nullptr);
  ASSERT_TRUE(done());
  const grpc::Slice bytes(std::string("\x0a\x02\xff\xfe", 4));
  stream->Write(grpc::ByteBuffer(&bytes, 1), nullptr);
  ASSERT_TRUE(done());
  grpc::ByteBuffer answer;
  stream->Read(&answer, nullptr);
  ASSERT_TRUE(done());
  v1::StreamPredictResponse response;
  ASSERT_TRUE(
      grpc::SerializationTraits<v1::StreamPredictResponse>::Deserialize(&answer, &response).ok());
  EXPECT_EQ(response.request_id(), "");
  EXPECT_EQ(response.error().code(), grpc::StatusCode::INVALID_ARGUMENT);
  stream->WritesDone(nullptr);
  done();
  grpc::Status status;
  stream->Finish(&status, nullptr);
  done();
}

}  // namespace
}  // namespace maneuver::rpc::predict_stream_test
