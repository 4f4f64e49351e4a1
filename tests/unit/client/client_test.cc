#include "client/client.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <future>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/error_details.h"
#include "tests/unit/client/test_calls.h"
#include "tests/unit/client/test_server.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::client::client_test {
namespace {

TEST(ClientTest, RetriesUnavailableUntilItIsAnswered) {
  TestServer server;
  std::atomic<int> calls = 0;
  server.on_predict = [&](auto*, const auto&, v1::PredictResponse* response) {
    if (++calls < 3) return Unavailable();
    response->set_model_version("models/town/versions/1");
    return grpc::Status::OK;
  };
  const auto answer = ConnectTo(server.address())->Predict({});
  ASSERT_TRUE(answer.ok()) << answer.status();
  EXPECT_EQ(answer->model_version(), "models/town/versions/1");
  EXPECT_EQ(calls, 3);
}

// gRPC ends calls like this that arrive while the server stops, and HAProxy those whose server
// died: the second way if the answer had begun.
TEST(ClientTest, RetriesACallThatWasBrokenOff) {
  TestServer server;
  std::atomic<int> calls = 0;
  server.on_predict = [&](auto*, const auto&, auto*) {
    switch (++calls) {
      case 1:
        return grpc::Status(grpc::StatusCode::CANCELLED, "");
      case 2:
        return grpc::Status(grpc::StatusCode::UNKNOWN, "Stream removed");
      default:
        return grpc::Status::OK;
    }
  };
  EXPECT_TRUE(ConnectTo(server.address())->Predict({}).ok());
  EXPECT_EQ(calls, 3);
}

TEST(ClientTest, LimitsTheAttempts) {
  TestServer server;
  std::atomic<int> calls = 0;
  server.on_predict = [&](auto*, const auto&, auto*) {
    ++calls;
    return Unavailable();
  };
  EXPECT_TRUE(absl::IsUnavailable(ConnectTo(server.address(), 3)->Predict({}).status()));
  EXPECT_EQ(calls, 3);
}

TEST(ClientTest, DoesNotRetryOtherErrors) {
  TestServer server;
  std::atomic<int> calls = 0;
  server.on_predict = [&](auto*, const auto&, auto*) {
    ++calls;
    return grpc::Status(grpc::StatusCode::RESOURCE_EXHAUSTED, "full");
  };
  EXPECT_TRUE(absl::IsResourceExhausted(ConnectTo(server.address())->Predict({}).status()));
  EXPECT_EQ(calls, 1);
}

TEST(ClientTest, DoesNotRetryDeletions) {
  TestServer server;
  std::atomic<int> calls = 0;
  server.on_delete_job = [&](const auto&) {
    ++calls;
    return Unavailable();
  };
  EXPECT_TRUE(absl::IsUnavailable(ConnectTo(server.address())->DeleteJob({})));
  EXPECT_EQ(calls, 1);
}

TEST(ClientTest, RetriesAReportOfOutcomesUnderOneRequestId) {
  TestServer server;
  std::mutex mutex;
  std::vector<std::string> ids;
  server.on_report_outcomes = [&](const v1::ReportOutcomesRequest& request, auto* response) {
    const std::lock_guard lock(mutex);
    ids.push_back(request.request_id());
    if (ids.size() == 1) return Unavailable();
    response->add_scores()->set_outcome_index(request.outcomes_size());
    return grpc::Status::OK;
  };
  const auto client = ConnectTo(server.address());
  v1::ReportOutcomesRequest request;
  request.add_outcomes();
  const auto response = client->ReportOutcomes(request);
  ASSERT_TRUE(response.ok()) << response.status();
  EXPECT_EQ(response->scores(0).outcome_index(), 1);
  ASSERT_EQ(ids.size(), 2U);
  EXPECT_GE(ids[0].size(), 32U);
  EXPECT_EQ(ids[0], ids[1]);
}

TEST(ClientTest, CallsThatReadAWholeDatasetHaveTheDeadlineOfUploads) {
  TestServer server;
  std::chrono::system_clock::time_point deadline;
  server.on_call = [&](const grpc::ServerContext& context) { deadline = context.deadline(); };
  ASSERT_TRUE(ConnectTo(server.address())->DescribeDataset({}).ok());
  const auto left = deadline - std::chrono::system_clock::now();
  EXPECT_GT(left, std::chrono::minutes(50));
  EXPECT_LT(left, std::chrono::minutes(61));
}

TEST(ClientTest, TrainCarriesOneRequestIdOverAllAttempts) {
  TestServer server;
  std::mutex mutex;
  std::vector<std::string> ids;
  server.on_train = [&](const v1::TrainRequest& request, v1::Job* job) {
    const std::lock_guard lock(mutex);
    ids.push_back(request.request_id());
    if (ids.size() % 2 == 1) return Unavailable();
    job->set_name("jobs/1");
    return grpc::Status::OK;
  };
  const auto client = ConnectTo(server.address());
  ASSERT_TRUE(client->Train({}).ok());
  ASSERT_TRUE(client->Train({}).ok());
  ASSERT_EQ(ids.size(), 4U);
  EXPECT_GE(ids[0].size(), 32U);
  EXPECT_EQ(ids[0], ids[1]);
  EXPECT_EQ(ids[2], ids[3]);
  EXPECT_NE(ids[0], ids[2]);

  v1::TrainRequest named;
  named.set_request_id("mine");
  ASSERT_TRUE(client->Train(named).ok());
  EXPECT_EQ(ids.back(), "mine");
}

TEST(ClientTest, DeadlineCoversAllAttempts) {
  TestServer server;
  std::atomic<int> calls = 0;
  server.on_predict = [&](grpc::ServerContext* context, const auto&, auto*) {
    ++calls;
    while (!context->IsCancelled()) std::this_thread::yield();
    return grpc::Status::CANCELLED;
  };
  const auto answer = ConnectTo(server.address())->Predict({}, {.timeout = absl::Milliseconds(50)});
  EXPECT_TRUE(absl::IsDeadlineExceeded(answer.status())) << answer.status();
  EXPECT_EQ(calls, 1);
}

TEST(ClientTest, CancellationEndsARunningCall) {
  TestServer server;
  Cancellation cancellation;
  server.on_predict = [&](grpc::ServerContext* context, const auto&, auto*) {
    cancellation.Cancel();
    while (!context->IsCancelled()) std::this_thread::yield();
    return grpc::Status::CANCELLED;
  };
  const auto client = ConnectTo(server.address());
  const CallOptions call{.cancellation = &cancellation};
  EXPECT_TRUE(absl::IsCancelled(client->Predict({}, call).status()));
  EXPECT_TRUE(
      absl::IsCancelled(client->Predict({}, call).status()));  // so do calls that start later
}

TEST(ClientTest, DetailsOfAnErrorArriveWithIt) {
  TestServer server;
  server.on_predict = [&](auto*, const auto&, auto*) {
    v1::Status rich;
    rich.set_code(grpc::StatusCode::INVALID_ARGUMENT);
    auto* info = rich.add_details();
    info->set_type_url("type.googleapis.com/google.rpc.ErrorInfo");
    v1::ErrorInfo reason;
    reason.set_reason("UNKNOWN_TARGET");
    info->set_value(reason.SerializeAsString());
    return grpc::Status(grpc::StatusCode::INVALID_ARGUMENT, "no such target",
                        rich.SerializeAsString());
  };
  const auto answer = ConnectTo(server.address())->Predict({});
  EXPECT_EQ(answer.status().message(), "no such target");
  EXPECT_EQ(ErrorDetailsOf(answer.status()).reason, "UNKNOWN_TARGET");
}

TEST(ClientTest, WatchContinuesAfterABrokenStreamWithoutRepeatingEvents) {
  TestServer server;
  std::atomic<int> streams = 0;
  server.on_watch = [&](const v1::WatchJobRequest& request, auto* writer) {
    ++streams;
    // Two events per stream, then it breaks; event 5 ends the job.
    for (int64_t i = request.after_sequence() + 1; i <= request.after_sequence() + 2; ++i) {
      v1::WatchJobResponse event;
      event.mutable_job()->mutable_progress()->set_sequence(i);
      event.mutable_job()->set_state(i == 5 ? v1::JOB_STATE_SUCCEEDED : v1::JOB_STATE_RUNNING);
      writer->Write(event);
      if (i == 5) return grpc::Status::OK;
    }
    return Unavailable();
  };
  std::vector<int64_t> seen;
  const auto job = ConnectTo(server.address())->WatchJob({}, [&](const v1::Job& event) {
    seen.push_back(event.progress().sequence());
    return true;
  });
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(seen, (std::vector<int64_t>{1, 2, 3, 4, 5}));
  EXPECT_EQ(streams, 3);
}

// A client that picks up a broken watch for 300 ms.
std::unique_ptr<Client> ConnectImpatiently(const std::string& address, OnRetry on_retry = {}) {
  ClientOptions options;
  options.on_retry = std::move(on_retry);
  options.address = address;
  options.retry = {.initial_backoff = absl::Milliseconds(1), .max_backoff = absl::Milliseconds(2)};
  options.watch_patience = absl::Milliseconds(300);
  return *Client::Connect(options);
}

TEST(ClientTest, WatchContinuesAndWaitsAfterSilentStreamsThatWereAccepted) {
  TestServer server;
  std::atomic<int> streams = 0;
  server.on_watch = [&](const auto&, auto* writer) {
    const int stream = ++streams;
    v1::WatchJobResponse event;
    event.mutable_job()->mutable_progress()->set_sequence(stream);
    event.mutable_job()->set_state(stream == 4 ? v1::JOB_STATE_SUCCEEDED : v1::JOB_STATE_RUNNING);
    if (stream == 1 || stream == 4) {
      writer->Write(event);
    } else {
      writer->SendInitialMetadata();
      std::this_thread::sleep_for(std::chrono::milliseconds(600));  // longer than the patience
    }
    return stream == 4 ? grpc::Status::OK : Unavailable();
  };
  int waits = 0;
  const auto count = [&](const absl::Status&, absl::Duration) { ++waits; };
  const auto job = ConnectImpatiently(server.address(), count)->WatchJob({}, nullptr);
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(streams, 4);
  EXPECT_EQ(waits, 2);  // the first stream had an event
}

TEST(ClientTest, WatchEndsIfTheServerAcceptsNoStreamAnyMore) {
  TestServer server;
  std::atomic<int> streams = 0;
  server.on_watch = [&](const auto&, auto* writer) {
    if (++streams == 1) {
      v1::WatchJobResponse event;
      event.mutable_job()->set_state(v1::JOB_STATE_RUNNING);
      writer->Write(event);
    }
    return Unavailable();
  };
  const auto job = ConnectImpatiently(server.address())->WatchJob({}, nullptr);
  EXPECT_TRUE(absl::IsUnavailable(job.status())) << job.status();
}

TEST(ClientTest, WatchStopsWhenTheCallerHasSeenEnough) {
  TestServer server;
  server.on_watch = [&](const auto&, auto* writer) {
    v1::WatchJobResponse event;
    event.mutable_job()->set_state(v1::JOB_STATE_RUNNING);
    while (writer->Write(event)) event.mutable_job()->mutable_progress()->set_sequence(1);
    return grpc::Status::CANCELLED;
  };
  int events = 0;
  const auto job =
      ConnectTo(server.address())->WatchJob({}, [&](const v1::Job&) { return ++events < 3; });
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(events, 3);
}

TEST(ClientTest, WatchReportsAnUnknownJob) {
  TestServer server;
  server.on_watch = [&](const auto&, auto*) {
    return grpc::Status(grpc::StatusCode::NOT_FOUND, "no job");
  };
  EXPECT_TRUE(absl::IsNotFound(ConnectTo(server.address())->WatchJob({}, nullptr).status()));
}

// A dataset folder with one shard.
class UploadTest : public testing::Test {
 protected:
  UploadTest() {
    for (int i = 0; i < 1'300'000; ++i) shard_ += static_cast<char>(i * 7 % 251);
    WriteBytes(folder_ / "scenarios-00000.tfrecord", shard_);
    WriteBytes(folder_ / "dataset.json", R"({"formatVersion": 1, "recordings": "3", "shards": [
        {"file": "scenarios-00000.tfrecord", "sizeBytes": "1300000", "records": "3"}]})");
  }

  const TemporaryFolder folder_;
  std::string shard_;
};

TEST_F(UploadTest, SendsTheHeaderAndThenEveryByte) {
  TestServer server;
  v1::UploadHeader header;
  std::string bytes;
  size_t largest = 0;
  server.on_upload = [&](auto* reader, v1::Dataset* dataset) {
    v1::UploadDatasetRequest request;
    while (reader->Read(&request)) {
      if (request.has_header()) header = request.header();
      bytes += request.chunk();
      largest = std::max(largest, request.chunk().size());
    }
    dataset->set_name(header.name());
    return grpc::Status::OK;
  };
  int64_t last_sent = 0;
  const auto dataset =
      ConnectTo(server.address())
          ->UploadDataset(folder_.path(), "datasets/x", [&](const UploadProgress& now) {
            EXPECT_TRUE(now.there > last_sent || now.there == 0);
            EXPECT_EQ(now.total, 1'300'000);
            EXPECT_EQ(now.resumed, 0);
            last_sent = now.there;
          });
  ASSERT_TRUE(dataset.ok()) << dataset.status();
  EXPECT_EQ(dataset->name(), "datasets/x");
  EXPECT_EQ(header.dataset().recordings(), 3);
  EXPECT_EQ(bytes, shard_);
  EXPECT_LE(largest, 1U << 20);
  EXPECT_EQ(last_sent, 1'300'000);
}

// A server that keeps what arrives. Upload i breaks off at its message `messages`[i]; uploads
// beyond those succeed.
class ServerThatBreaksOff {
 public:
  ServerThatBreaksOff(TestServer& server, std::vector<int> messages)
      : messages_(std::move(messages)) {
    server.on_query_upload = [this](const auto&, v1::QueryUploadResponse* response) {
      response->add_arrived_bytes(static_cast<int64_t>(kept.size()));
      return grpc::Status::OK;
    };
    server.on_upload = [this](auto* reader, v1::Dataset* dataset) {
      const size_t upload = uploads++;
      v1::UploadDatasetRequest request;
      for (int message = 0; reader->Read(&request); ++message) {
        if (request.has_header()) kept.resize(request.header().arrived_bytes(0));
        if (upload < messages_.size() && message == messages_[upload]) {
          return grpc::Status(grpc::StatusCode::UNAVAILABLE, "broken");
        }
        kept += request.chunk();
        received += static_cast<int64_t>(request.chunk().size());
      }
      dataset->set_name("datasets/x");
      return grpc::Status::OK;
    };
  }
  std::string kept;
  int64_t received = 0;
  size_t uploads = 0;

 private:
  const std::vector<int> messages_;
};

TEST_F(UploadTest, ContinuesWhereItBrokeOffAndSendsNothingTwice) {
  TestServer server;
  ServerThatBreaksOff keeper(server, {1, 2, 2});
  std::vector<int64_t> resumed;
  const auto dataset =
      ConnectTo(server.address())
          ->UploadDataset(folder_.path(), "datasets/x",
                          [&](const UploadProgress& now) { resumed.push_back(now.resumed); });
  ASSERT_TRUE(dataset.ok()) << dataset.status();
  EXPECT_EQ(keeper.uploads, 4u);
  EXPECT_EQ(keeper.kept, shard_);
  EXPECT_EQ(keeper.received, 1'300'000);
  // Bytes that this call sent itself do not count as resumed.
  for (const int64_t bytes : resumed) EXPECT_EQ(bytes, 0);
}

TEST_F(UploadTest, ReportsWhatHadArrivedBefore) {
  TestServer server;
  ServerThatBreaksOff keeper(server, {});
  keeper.kept = shard_.substr(0, 1'000'000);
  UploadProgress last;
  const auto dataset = ConnectTo(server.address())
                           ->UploadDataset(folder_.path(), "datasets/x",
                                           [&](const UploadProgress& now) { last = now; });
  ASSERT_TRUE(dataset.ok()) << dataset.status();
  EXPECT_EQ(keeper.received, 300'000);
  EXPECT_EQ(keeper.kept, shard_);
  EXPECT_EQ(last.resumed, 1'000'000);
  EXPECT_EQ(last.there, last.total);
}

TEST_F(UploadTest, SucceedsIfOnlyTheAnswerToTheCommitWasLost) {
  TestServer server;
  bool is_committed = false;
  server.on_query_upload = [&](const auto& request, v1::QueryUploadResponse* response) {
    response->add_arrived_bytes(0);
    if (is_committed) response->mutable_committed()->set_name(request.name());
    return grpc::Status::OK;
  };
  server.on_upload = [&](auto* reader, v1::Dataset*) {
    v1::UploadDatasetRequest request;
    while (reader->Read(&request)) {
    }
    is_committed = true;
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "broken");
  };
  const auto dataset =
      ConnectTo(server.address())->UploadDataset(folder_.path(), "datasets/x", nullptr);
  ASSERT_TRUE(dataset.ok()) << dataset.status();
  EXPECT_EQ(dataset->name(), "datasets/x");
}

TEST_F(UploadTest, SendsADamagedPartAgainOnce) {
  TestServer server;
  ServerThatBreaksOff keeper(server, {});
  const auto upload = server.on_upload;
  keeper.kept = "wrong";
  int losses = 0;
  int most_losses = 1;
  server.on_upload = [&](auto* reader, v1::Dataset* dataset) {
    const grpc::Status status = upload(reader, dataset);
    if (losses == most_losses) return status;
    ++losses;
    keeper.kept = most_losses == 1 ? "" : "wrong again";
    return grpc::Status(grpc::StatusCode::DATA_LOSS, "another SHA-256");
  };
  const auto client = ConnectTo(server.address());
  EXPECT_TRUE(client->UploadDataset(folder_.path(), "datasets/x", nullptr).ok());
  EXPECT_EQ(keeper.kept, shard_);
  // But not forever.
  losses = 0;
  most_losses = 100;
  keeper.kept = "wrong";
  EXPECT_TRUE(
      absl::IsDataLoss(client->UploadDataset(folder_.path(), "datasets/x", nullptr).status()));
  EXPECT_EQ(losses, 2);
}

TEST_F(UploadTest, CountsWhatArrivesAfterACleanStartAsProgress) {
  TestServer server;
  // The first upload is too short to break off.
  ServerThatBreaksOff keeper(server, {2, 2, 2});
  const auto upload = server.on_upload;
  keeper.kept = std::string(1'200'000, '?');
  bool is_damaged = true;
  server.on_upload = [&](auto* reader, v1::Dataset* dataset) {
    const grpc::Status status = upload(reader, dataset);
    if (!std::exchange(is_damaged, false)) return status;
    keeper.kept.clear();
    return grpc::Status(grpc::StatusCode::DATA_LOSS, "another SHA-256");
  };
  int waits = 0;
  ClientOptions options;
  options.address = server.address();
  options.retry.initial_backoff = absl::Milliseconds(1);
  options.on_retry = [&](const absl::Status&, absl::Duration) { ++waits; };
  UploadProgress last;
  const auto dataset = (*Client::Connect(options))
                           ->UploadDataset(folder_.path(), "datasets/x",
                                           [&](const UploadProgress& now) { last = now; });
  ASSERT_TRUE(dataset.ok()) << dataset.status();
  EXPECT_EQ(keeper.uploads, 4u);
  EXPECT_EQ(keeper.kept, shard_);
  EXPECT_EQ(waits, 1);  // before the first byte of the clean start
  EXPECT_EQ(last.resumed, 0);
  EXPECT_EQ(last.there, last.total);
}

TEST_F(UploadTest, ReturnsTheServersError) {
  TestServer server;
  server.on_upload = [&](auto*, auto*) {
    return grpc::Status(grpc::StatusCode::ALREADY_EXISTS, "datasets/x exists");
  };
  const auto dataset =
      ConnectTo(server.address())->UploadDataset(folder_.path(), "datasets/x", nullptr);
  EXPECT_TRUE(absl::IsAlreadyExists(dataset.status())) << dataset.status();
}

TEST_F(UploadTest, DoesNotSendAnIncompleteFolder) {
  const auto client = ConnectTo("127.0.0.1:1");  // no server is needed
  WriteBytes(folder_ / "scenarios-00000.tfrecord", "short");
  EXPECT_TRUE(
      absl::IsDataLoss(client->UploadDataset(folder_.path(), "datasets/x", nullptr).status()));
  std::filesystem::remove(folder_ / "dataset.json");
  EXPECT_TRUE(
      absl::IsNotFound(client->UploadDataset(folder_.path(), "datasets/x", nullptr).status()));
}

TEST_F(UploadTest, ReadsAManifestWithItsDigestAndRefusesAnother) {
  // {"recordings": "3"} as the server's tools write it, with the SHA-256 of all but the first line.
  const std::string sealed =
      "{\n \"content_sha256\": "
      "\"24b1ec8f745040042abeafb631c85cf420763572c80fe7903b379c3a678008e4\",\n \"recordings\": "
      "\"3\"\n}\n";
  const auto client = ConnectTo("127.0.0.1:1");  // no server is needed
  std::string altered = sealed;
  altered.replace(altered.find("\"3\""), 3, "\"4\"");
  WriteBytes(folder_ / "dataset.json", altered);
  const auto refused = client->UploadDataset(folder_.path(), "datasets/x", nullptr);
  EXPECT_TRUE(absl::IsDataLoss(refused.status())) << refused.status();
  TestServer server;
  v1::Dataset sent;
  server.on_upload = [&](auto* reader, v1::Dataset*) {
    v1::UploadDatasetRequest request;
    while (reader->Read(&request)) {
      if (request.has_header()) sent = request.header().dataset();
    }
    return grpc::Status::OK;
  };
  WriteBytes(folder_ / "dataset.json", sealed);
  ASSERT_TRUE(
      ConnectTo(server.address())->UploadDataset(folder_.path(), "datasets/x", nullptr).ok());
  EXPECT_EQ(sent.recordings(), 3);
}

TEST(PredictStreamTest, AnswersEveryRequestUnderItsId) {
  TestServer server;
  server.on_stream = [](auto* stream) {
    v1::StreamPredictRequest request;
    while (stream->Read(&request)) {
      v1::StreamPredictResponse response;
      response.set_request_id(request.request_id());
      response.mutable_response()->set_model_version(request.request().model());
      EXPECT_EQ(request.timeout().nanos(), 80'000'000);
      stream->Write(response);
    }
    return grpc::Status::OK;
  };
  const auto client = ConnectTo(server.address());
  std::set<std::string> answered;
  const auto stream = client->StreamPredict([&](const v1::StreamPredictResponse& response) {
    EXPECT_EQ(response.response().model_version(), "models/town");
    answered.insert(response.request_id());
  });
  v1::PredictRequest request;
  request.set_model("models/town");
  for (const char* id : {"a", "b", "c"}) {
    EXPECT_TRUE(stream->Send(id, request, absl::Milliseconds(80)).ok());
  }
  EXPECT_TRUE(stream->Finish().ok());
  EXPECT_EQ(answered, (std::set<std::string>{"a", "b", "c"}));
  EXPECT_TRUE(absl::IsFailedPrecondition(stream->Send("d", request)));
}

TEST(PredictStreamTest, FinishReturnsWhyTheStreamBroke) {
  TestServer server;
  server.on_stream = [](auto*) {
    return grpc::Status(grpc::StatusCode::RESOURCE_EXHAUSTED, "too many streams");
  };
  const auto stream = ConnectTo(server.address())->StreamPredict(nullptr);
  EXPECT_TRUE(absl::IsResourceExhausted(stream->Finish()));
}

TEST(ConnectTest, RefusesInvalidOptions) {
  EXPECT_TRUE(absl::IsInvalidArgument(Client::Connect({.address = ""}).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(Client::Connect({.retry = {.max_attempts = 0}}).status()));
}

TEST(ClientTest, EveryKindOfCallSendsTheCallersIdentity) {
  TestServer server;
  std::mutex mutex;
  std::vector<std::string> seen;
  server.on_call = [&](const grpc::ServerContext& context) {
    const std::lock_guard lock(mutex);
    const auto header = context.client_metadata().find("authorization");
    seen.push_back(header == context.client_metadata().end()
                       ? ""
                       : std::string(header->second.data(), header->second.size()));
  };
  server.on_predict = [](auto*, const auto&, auto*) { return grpc::Status::OK; };
  server.on_delete_job = [](const auto&) { return grpc::Status::OK; };
  server.on_watch = [](const auto&, auto* writer) {
    v1::WatchJobResponse event;
    event.mutable_job()->set_state(v1::JOB_STATE_SUCCEEDED);
    writer->Write(event);
    return grpc::Status::OK;
  };
  server.on_stream = [](auto*) { return grpc::Status::OK; };
  server.on_stream_outcomes = [](OutcomeServerStream* stream) {
    v1::StreamOutcomesRequest request;
    stream->Read(&request);
    AnswerReport(request.report(), stream);
    return grpc::Status::OK;
  };
  const auto client = Client::Connect({.address = server.address(), .token = "abc"});
  ASSERT_TRUE(client.ok()) << client.status();
  EXPECT_TRUE((*client)->Predict({}).ok());
  EXPECT_TRUE((*client)->DeleteJob({}).ok());
  const auto outcomes = (*client)->StreamOutcomes(nullptr);
  EXPECT_TRUE(outcomes->Send(ReportOf(1)).ok());
  EXPECT_TRUE(outcomes->Finish().ok());
  EXPECT_TRUE((*client)->WatchJob({}, {}).ok());
  EXPECT_TRUE((*client)->StreamPredict({})->Finish().ok());
  EXPECT_EQ(seen, std::vector<std::string>(5, "Bearer abc"));
}

TEST(ClientTest, RefusesATokenOverAnUnencryptedNetwork) {
  for (const char* address : {"192.0.2.1:8470", "example.com:8470", "[2001:db8::1]:8470",
                              "127.0.0.1.example.com:8470", "dns:///localhost.example.com:1"}) {
    const auto refused = Client::Connect({.address = address, .token = "abc"});
    EXPECT_TRUE(absl::IsFailedPrecondition(refused.status())) << address;
    EXPECT_TRUE(Client::Connect({.address = address}).ok()) << address;
    EXPECT_TRUE(Client::Connect({.address = address, .tls = TlsOptions{}, .token = "abc"}).ok());
  }
  for (const char* address : {"127.0.0.1:1", "localhost:1", "[::1]:1", "unix:/run/x"}) {
    EXPECT_TRUE(Client::Connect({.address = address, .token = "abc"}).ok()) << address;
  }
}

TEST(ClientTest, ReachesALocalServerWithoutTheProxyOfTheEnvironment) {
  TestServer server;
  server.on_predict = [](auto*, const auto&, auto*) { return grpc::Status::OK; };
  setenv("grpc_proxy", "http://127.0.0.1:1", 1);  // before http_proxy; nobody listens there
  const absl::Status status = ConnectTo(server.address(), 1)->Predict({}).status();
  unsetenv("grpc_proxy");
  EXPECT_TRUE(status.ok()) << status;
}

TEST(ClientTest, NamesInvalidCredentialFiles) {
  const TemporaryFolder folder;
  const std::string empty = folder / "empty";
  WriteBytes(empty, "\n");
  EXPECT_TRUE(absl::IsNotFound(Client::Connect({.token_file = folder / "none"}).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(Client::Connect({.token_file = empty}).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(Client::Connect({.token = "a\nb"}).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(
      Client::Connect({.tls = TlsOptions{.root_certificates = empty}}).status()));
  EXPECT_TRUE(
      absl::IsInvalidArgument(Client::Connect({.tls = TlsOptions{.certificate = empty}}).status()));
  const absl::Status endless =
      Client::Connect({.tls = TlsOptions{.root_certificates = "/dev/zero"}}).status();
  EXPECT_EQ(endless.message(), "/dev/zero has more than 16 MiB");
  const absl::Status unread = Client::Connect({.token_file = "/proc/self/mem"}).status();
  EXPECT_EQ(unread.message(), "/proc/self/mem cannot be read");
  const std::string key = folder / "ca.key";
  WriteBytes(key, "-----BEGIN PRIVATE KEY-----\nMC4=\n-----END PRIVATE KEY-----\n");
  const absl::Status key_as_authority =
      Client::Connect({.tls = TlsOptions{.root_certificates = key}}).status();
  EXPECT_TRUE(absl::IsInvalidArgument(key_as_authority));
  EXPECT_EQ(key_as_authority.message(), key + " holds a private key, not a certificate");
}

}  // namespace
}  // namespace maneuver::client::client_test
