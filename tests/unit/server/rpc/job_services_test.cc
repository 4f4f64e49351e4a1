// Datasets and jobs over gRPC, with a real store and a real process as the trainer.

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <algorithm>
#include <chrono>
#include <latch>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "maneuver/v1/dataset_service.grpc.pb.h"
#include "maneuver/v1/training_service.grpc.pb.h"
#include "model/files/durable_file.h"
#include "server/errors/error_details.h"
#include "server/monitoring/prometheus_metrics.h"
#include "server/rpc/dataset_service.h"
#include "server/rpc/training_service.h"
#include "server/security/identities.h"
#include "server/security/periodic_reload.h"
#include "server/security/secret_file.h"
#include "tests/unit/server/jobs/supervisor_fixture.h"

namespace maneuver::rpc::job_services_test {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// ErrorInfo.reason of a failed call.
std::string Reason(const grpc::Status& status) {
  v1::Status details;
  v1::ErrorInfo info;
  if (!details.ParseFromString(status.error_details()) || details.details().empty()) return "";
  info.ParseFromString(details.details(0).value());
  return info.reason();
}

class JobServicesTest : public jobs::SupervisorTest {
 protected:
  void SetUp() override {
    Start();
    WriteTokens(*security::TokenLine("ada", *security::RoleSet::Parse("train"), "secret"));
    access_ = *security::AccessControl::Create({.identities = folder_ / "tokens"}, *metrics_);
    dataset_service_ =
        std::make_unique<DatasetService>(*datasets_, *supervisor_, blocking_, *access_);
    training_service_ = std::make_unique<TrainingService>(*supervisor_, blocking_, *access_);
    grpc::ServerBuilder builder;
    builder.RegisterService(dataset_service_.get());
    builder.RegisterService(training_service_.get());
    server_ = builder.BuildAndStart();
    ASSERT_NE(server_, nullptr);
    const auto channel = server_->InProcessChannel({});
    datasets_stub_ = v1::DatasetService::NewStub(channel);
    training_stub_ = v1::TrainingService::NewStub(channel);
  }
  ~JobServicesTest() override {
    supervisor_->Stop();
    server_->Shutdown(std::chrono::system_clock::now());
  }

  // Changes a row beside the store, which the server has open.
  void DamageJob(const std::string& sql) {
    sqlite3* database = nullptr;
    ASSERT_EQ(sqlite3_open((folder_ / "maneuver.db").c_str(), &database), SQLITE_OK);
    sqlite3_busy_timeout(database, 10'000);
    EXPECT_EQ(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK)
        << sqlite3_errmsg(database);
    sqlite3_close(database);
  }

  void WriteTokens(const std::string& lines) {
    std::filesystem::remove(folder_ / "tokens");
    ASSERT_TRUE(security::AppendLine(folder_ / "tokens", lines).ok());
  }

  // The dataset "town" of the fixture, as a client has it.
  v1::UploadDatasetRequest Header(const std::string& name) {
    v1::UploadDatasetRequest message;
    message.mutable_header()->set_name(name);
    *message.mutable_header()->mutable_dataset() = *data::ReadDatasetManifest(town_);
    return message;
  }
  std::string Bytes() {
    return *files::ReadFile(town_ / Header("").header().dataset().shards(0).file());
  }
  static v1::UploadDatasetRequest Chunk(const std::string& bytes) {
    v1::UploadDatasetRequest message;
    message.set_chunk(bytes);
    return message;
  }

  grpc::Status Upload(const std::vector<v1::UploadDatasetRequest>& messages) {
    grpc::ClientContext context;
    uploaded_.Clear();
    const auto writer = datasets_stub_->UploadDataset(&context, &uploaded_);
    for (const auto& message : messages) {
      if (!writer->Write(message)) break;
    }
    writer->WritesDone();
    return writer->Finish();
  }

  // All jobs that a watch told of.
  grpc::Status Watch(const std::string& name, int64_t after, std::vector<v1::Job>* jobs) {
    grpc::ClientContext context;
    v1::WatchJobRequest request;
    request.set_name(name);
    request.set_after_sequence(after);
    const auto reader = training_stub_->WatchJob(&context, request);
    v1::WatchJobResponse response;
    while (reader->Read(&response)) jobs->push_back(response.job());
    return reader->Finish();
  }

  v1::Job TrainOverTheWire() {
    grpc::ClientContext context;
    v1::Job job;
    const grpc::Status status = training_stub_->Train(&context, TrainTown(), &job);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return job;
  }

  // What broke off lies in one of its own.
  std::vector<std::string> NamesInStore() {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / "datasets")) {
      if (entry.path().filename() != ".uploads") names.push_back(entry.path().filename());
    }
    std::ranges::sort(names);
    return names;
  }

  const std::filesystem::path town_ = folder_ / "datasets" / "town";
  const std::unique_ptr<monitoring::PrometheusMetrics> metrics_ =
      monitoring::PrometheusMetrics::Create();
  serving::SendMemory send_memory_{{.max_send_memory = 1 << 20}, *metrics_};
  WorkerPool pool_{2, 100};
  const BlockingWork blocking_{pool_, send_memory_};
  std::unique_ptr<security::AccessControl> access_;
  std::unique_ptr<DatasetService> dataset_service_;
  std::unique_ptr<TrainingService> training_service_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<v1::DatasetService::Stub> datasets_stub_;
  std::unique_ptr<v1::TrainingService::Stub> training_stub_;
  v1::Dataset uploaded_;
};

TEST_F(JobServicesTest, ListsDescribesReadsAndDeletesAnUploadedDataset) {
  const std::string bytes = Bytes();
  const grpc::Status status = Upload(
      {Header("datasets/a"), Chunk(bytes.substr(0, 100)), Chunk(""), Chunk(bytes.substr(100))});
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(uploaded_.name(), "datasets/a");
  EXPECT_EQ(uploaded_.recordings(), 1);

  v1::ListDatasetsRequest list;
  list.set_page_size(2);
  v1::ListDatasetsResponse page;
  grpc::ClientContext first;
  ASSERT_TRUE(datasets_stub_->ListDatasets(&first, list, &page).ok());
  ASSERT_EQ(page.datasets_size(), 2);
  EXPECT_EQ(page.datasets(0).name(), "datasets/a");
  list.set_page_token(page.next_page_token());
  grpc::ClientContext second;
  ASSERT_TRUE(datasets_stub_->ListDatasets(&second, list, &page).ok());
  ASSERT_EQ(page.datasets_size(), 1);
  EXPECT_EQ(page.next_page_token(), "");

  v1::DescribeDatasetRequest describe;
  describe.set_name("datasets/a");
  v1::DatasetSummary summary;
  grpc::ClientContext third;
  ASSERT_TRUE(datasets_stub_->DescribeDataset(&third, describe, &summary).ok());
  EXPECT_EQ(summary.agents_by_type().at("VEHICLE"), 1);

  v1::ListScenariosRequest scenarios;
  scenarios.set_parent("datasets/a");
  v1::ListScenariosResponse listed;
  grpc::ClientContext fourth;
  ASSERT_TRUE(datasets_stub_->ListScenarios(&fourth, scenarios, &listed).ok());
  ASSERT_EQ(listed.scenarios_size(), 1);
  EXPECT_EQ(listed.scenarios(0).scenario_id(), "r0");

  v1::GetScenarioRequest get;
  get.set_parent("datasets/a");
  get.set_scenario_id("none");
  v1::Scenario scenario;
  grpc::ClientContext fifth;
  EXPECT_EQ(Reason(datasets_stub_->GetScenario(&fifth, get, &scenario)), "SCENARIO_NOT_FOUND");
  get.set_scenario_id("r0");
  grpc::ClientContext sixth;
  ASSERT_TRUE(datasets_stub_->GetScenario(&sixth, get, &scenario).ok());
  EXPECT_EQ(scenario.agents_size(), 2);

  v1::DeleteDatasetRequest remove;
  remove.set_name("datasets/a");
  google::protobuf::Empty nothing;
  grpc::ClientContext seventh;
  ASSERT_TRUE(datasets_stub_->DeleteDataset(&seventh, remove, &nothing).ok());
  grpc::ClientContext eighth;
  EXPECT_EQ(Reason(datasets_stub_->DeleteDataset(&eighth, remove, &nothing)), "DATASET_NOT_FOUND");
  EXPECT_THAT(NamesInStore(), ElementsAre("town", "village"));
}

TEST_F(JobServicesTest, ACallThatIsGivenUpIsNotMadeWhenItsTurnComes) {
  bool is_kept = false;
  // The server learns of it a moment after the caller.
  for (const int milliseconds : {100, 1'000, 10'000}) {
    const grpc::Status uploaded = Upload({Header("datasets/a"), Chunk(Bytes())});
    ASSERT_TRUE(uploaded.ok()) << uploaded.error_message();
    const auto opens = std::make_shared<std::latch>(1);
    for (int i = 0; i < 2; ++i) ASSERT_TRUE(pool_.Post([opens] { opens->wait(); }));
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(50));
    v1::DeleteDatasetRequest remove;
    remove.set_name("datasets/a");
    google::protobuf::Empty nothing;
    EXPECT_EQ(datasets_stub_->DeleteDataset(&context, remove, &nothing).error_code(),
              grpc::StatusCode::DEADLINE_EXCEEDED);
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
    opens->count_down();
    // Both threads meet here, so what was posted earlier is done.
    const auto meet = std::make_shared<std::latch>(2);
    const auto met = std::make_shared<std::latch>(2);
    for (int i = 0; i < 2; ++i) {
      ASSERT_TRUE(pool_.Post([meet, met] {
        meet->arrive_and_wait();
        met->count_down();
      }));
    }
    met->wait();
    is_kept = std::ranges::count(NamesInStore(), "a") == 1;
    if (is_kept) break;
  }
  EXPECT_TRUE(is_kept);
}

TEST_F(JobServicesTest, RefusesEveryWrongUploadWithItsReasonAndLeavesNothing) {
  const std::string bytes = Bytes();
  std::string altered = bytes;
  altered[50] ^= 1;
  v1::UploadDatasetRequest escaping = Header("datasets/a");
  escaping.mutable_header()->mutable_dataset()->mutable_shards(0)->set_file("../x");
  struct Case {
    const char* name;
    std::vector<v1::UploadDatasetRequest> messages;
    grpc::StatusCode code;
    const char* reason;
    std::string words;
  };
  const std::vector<Case> cases = {
      {"no message", {}, grpc::StatusCode::INVALID_ARGUMENT, "INVALID_FIELD", "header"},
      {"no header", {Chunk(bytes)}, grpc::StatusCode::INVALID_ARGUMENT, "INVALID_FIELD", "header"},
      {"two headers",
       {Header("datasets/a"), Header("datasets/a")},
       grpc::StatusCode::INVALID_ARGUMENT,
       "INVALID_FIELD",
       "header"},
      {"a name that leads out",
       {Header("datasets/..")},
       grpc::StatusCode::INVALID_ARGUMENT,
       "INVALID_FIELD",
       "header.name"},
      {"a file that leads out",
       {escaping},
       grpc::StatusCode::INVALID_ARGUMENT,
       "INVALID_FIELD",
       "header.dataset.shards[0].file"},
      {"a name that is taken",
       {Header("datasets/town"), Chunk(bytes)},
       grpc::StatusCode::ALREADY_EXISTS,
       "DATASET_EXISTS",
       "datasets/town"},
      {"too few bytes",
       {Header("datasets/a"), Chunk(bytes.substr(1))},
       grpc::StatusCode::INVALID_ARGUMENT,
       "DATASET_INVALID",
       "scenarios-00000.tfrecord"},
      {"too many bytes",
       {Header("datasets/a"), Chunk(bytes + "x")},
       grpc::StatusCode::INVALID_ARGUMENT,
       "DATASET_INVALID",
       "more bytes"},
      {"an altered byte",
       {Header("datasets/a"), Chunk(altered)},
       grpc::StatusCode::DATA_LOSS,
       "DATASET_DAMAGED",
       "scenarios-00000.tfrecord"},
      {"a chunk that is too large",
       {Header("datasets/a"), Chunk(std::string((1 << 20) + 1, 'x'))},
       grpc::StatusCode::INVALID_ARGUMENT,
       "INVALID_FIELD",
       "chunk"},
  };
  for (const Case& c : cases) {
    const grpc::Status status = Upload(c.messages);
    EXPECT_EQ(status.error_code(), c.code) << c.name << ": " << status.error_message();
    EXPECT_EQ(Reason(status), c.reason) << c.name;
    EXPECT_THAT(status.error_message(), HasSubstr(c.words)) << c.name;
    EXPECT_THAT(NamesInStore(), ElementsAre("town", "village")) << c.name;
  }
}

TEST_F(JobServicesTest, TellsWhichBytesAreAlreadyThereAndChecksThem) {
  v1::QueryUploadRequest question;
  question.set_name("datasets/a");
  *question.mutable_dataset() = Header("").header().dataset();
  v1::QueryUploadResponse answer;
  const auto ask = [&] {
    grpc::ClientContext context;
    return datasets_stub_->QueryUpload(&context, question, &answer);
  };
  ASSERT_TRUE(ask().ok());
  EXPECT_THAT(answer.arrived_bytes(), ElementsAre(0));
  const std::string bytes = Bytes();
  EXPECT_FALSE(Upload({Header("datasets/a"), Chunk(bytes.substr(0, 1000))}).ok());
  ASSERT_TRUE(ask().ok());
  EXPECT_THAT(answer.arrived_bytes(), ElementsAre(1000));

  const auto header = [&](std::vector<int64_t> arrived) {
    v1::UploadDatasetRequest message = Header("datasets/a");
    message.mutable_header()->mutable_arrived_bytes()->Add(arrived.begin(), arrived.end());
    return message;
  };
  const auto size = static_cast<int64_t>(bytes.size());
  for (const std::vector<int64_t>& wrong :
       {std::vector<int64_t>{-1}, std::vector<int64_t>{size + 1}, std::vector<int64_t>{1, 1}}) {
    const grpc::Status status = Upload({header(wrong)});
    EXPECT_EQ(Reason(status), "INVALID_FIELD");
    EXPECT_THAT(status.error_message(), HasSubstr("header.arrived_bytes"));
  }
  EXPECT_EQ(Reason(Upload({header({1001}), Chunk(bytes.substr(1001))})), "UPLOAD_CHANGED");
  const grpc::Status resumed = Upload({header({1000}), Chunk(bytes.substr(1000))});
  ASSERT_TRUE(resumed.ok()) << resumed.error_message();
  ASSERT_TRUE(ask().ok());
  EXPECT_EQ(answer.committed().name(), "datasets/a");

  question.set_name("datasets/..");
  EXPECT_THAT(ask().error_message(), HasSubstr("name"));
  question.set_name("datasets/a");
  question.mutable_dataset()->mutable_shards(0)->set_sha256("x");
  EXPECT_THAT(ask().error_message(), HasSubstr("dataset.shards[0].sha256"));
}

TEST_F(JobServicesTest, RefusesAHeaderOfEmptyElementsBeforeItIsParsed) {
  v1::UploadDatasetRequest header = Header("datasets/a");
  for (int i = 0; i < 600'000; ++i) header.mutable_header()->mutable_dataset()->add_shards();
  const grpc::Status status = Upload({header});
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_message(), HasSubstr("leave out empty elements"));
  EXPECT_THAT(NamesInStore(), ElementsAre("town", "village"));
}

TEST_F(JobServicesTest, RefusesAChunkOfMoreThanOneMebibyte) {
  for (const size_t bytes : {(size_t{1} << 20) + 1, size_t{2} << 20}) {
    const grpc::Status status = Upload({Header("datasets/a"), Chunk(std::string(bytes, 'x'))});
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    EXPECT_THAT(status.error_message(), HasSubstr("chunk: must have at most 1 MiB"));
  }
}

TEST_F(JobServicesTest, AnUploadOfBytesThatAreNoMessageIsInvalid) {
  v1::UploadDatasetRequest broken;
  // In place of the header.
  broken.GetReflection()->MutableUnknownFields(&broken)->AddLengthDelimited(1, "\xff");
  for (const auto& messages : {std::vector{broken}, std::vector{Header("datasets/a"), broken}}) {
    const grpc::Status status = Upload(messages);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    EXPECT_THAT(status.error_message(), HasSubstr("do not parse"));
  }
}

TEST_F(JobServicesTest, AnInterruptedUploadIsNotADataset) {
  {
    grpc::ClientContext context;
    const auto writer = datasets_stub_->UploadDataset(&context, &uploaded_);
    ASSERT_TRUE(writer->Write(Header("datasets/a")));
    ASSERT_TRUE(writer->Write(Chunk(Bytes())));
    context.TryCancel();
    EXPECT_EQ(writer->Finish().error_code(), grpc::StatusCode::CANCELLED);
  }
  // Ends once the server has done with every call.
  server_->Shutdown();
  EXPECT_THAT(NamesInStore(), ElementsAre("town", "village"));
}

TEST_F(JobServicesTest, AWatchReplaysFromTheStartOrACursorAndEndsWithTheJob) {
  Trainer(R"(for i in 1 2 3 4 5; do
               echo "{\"phase\":\"joint\",\"epoch\":$i,\"epochReport\":{}}"
             done
             mkdir "$output")");
  const v1::Job job = TrainOverTheWire();
  std::vector<v1::Job> live;
  std::vector<v1::Job> replayed;
  std::vector<v1::Job> rest;
  ASSERT_TRUE(Watch(job.name(), 0, &live).ok());
  ASSERT_TRUE(Watch(job.name(), 0, &replayed).ok());
  ASSERT_TRUE(Watch(job.name(), 4, &rest).ok());
  ASSERT_EQ(live.size(), 6u);
  ASSERT_EQ(replayed.size(), 6u);
  for (size_t i = 0; i < live.size(); ++i) {
    EXPECT_EQ(live[i].SerializeAsString(), replayed[i].SerializeAsString());
  }
  EXPECT_EQ(live[4].progress().epoch(), 5);
  EXPECT_EQ(live[4].state(), v1::JOB_STATE_RUNNING);
  EXPECT_EQ(live[5].state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(live[5].model_version(), "models/town/versions/1");
  EXPECT_EQ(rest.size(), 2u);
}

TEST_F(JobServicesTest, RevokingATokenEndsItsUploadsAndWatches) {
  Trainer(jobs::kRunsOn);
  const v1::Job job = TrainOverTheWire();
  grpc::ClientContext watch_context;
  watch_context.AddMetadata("authorization", "Bearer secret");
  v1::WatchJobRequest request;
  request.set_name(job.name());
  const auto watch = training_stub_->WatchJob(&watch_context, request);
  v1::WatchJobResponse event;
  ASSERT_TRUE(watch->Read(&event));
  grpc::ClientContext upload_context;
  upload_context.AddMetadata("authorization", "Bearer secret");
  v1::Dataset dataset;
  const auto upload = datasets_stub_->UploadDataset(&upload_context, &dataset);
  ASSERT_TRUE(upload->Write(Header("datasets/other")));

  const security::PeriodicReload reload({{"tokens", [this] { return access_->Reload(); }}},
                                        std::chrono::milliseconds(10));
  WriteTokens("# nobody\n");
  while (watch->Read(&event)) {
  }
  for (const grpc::Status& status : {watch->Finish(), upload->Finish()}) {
    EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAUTHENTICATED);
    EXPECT_EQ(Reason(status), "TOKEN_UNKNOWN");
  }
  EXPECT_THAT(NamesInStore(), ElementsAre("town", "village"));
}

TEST_F(JobServicesTest, RefusesToWatchAnUnknownJob) {
  std::vector<v1::Job> jobs;
  EXPECT_EQ(Reason(Watch("jobs/none", 0, &jobs)), "JOB_NOT_FOUND");
  EXPECT_EQ(Watch("jobs/../x", 0, &jobs).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(Watch("jobs/none", -1, &jobs).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(jobs, IsEmpty());
}

TEST_F(JobServicesTest, UnreadAnswersRefuseCallsBeforeTheyDoAnythingButDeletions) {
  Trainer("mkdir \"$output\"");
  const v1::Job job = TrainOverTheWire();
  const auto get_scenario = [this] {
    grpc::ClientContext context;
    v1::GetScenarioRequest request;
    request.set_parent("datasets/town");
    request.set_scenario_id("r0");
    v1::Scenario scenario;
    return datasets_stub_->GetScenario(&context, request, &scenario);
  };
  std::vector<v1::Job> news;
  {
    const serving::SendMemory::Share unread = send_memory_.Take(1 << 20);
    const grpc::Status refused = get_scenario();
    EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_EQ(Reason(refused), "SEND_MEMORY_FULL");
    EXPECT_THAT(refused.error_details(), HasSubstr("google.rpc.RetryInfo"));
    EXPECT_EQ(Reason(Watch(job.name(), 0, &news)), "SEND_MEMORY_FULL");
    {
      grpc::ClientContext context;
      v1::Job another;
      EXPECT_EQ(Reason(training_stub_->Train(&context, TrainTown(), &another)), "SEND_MEMORY_FULL");
    }
    grpc::ClientContext context;
    v1::DeleteDatasetRequest request;
    request.set_name("datasets/village");
    google::protobuf::Empty nothing;
    EXPECT_TRUE(datasets_stub_->DeleteDataset(&context, request, &nothing).ok());
  }
  EXPECT_TRUE(get_scenario().ok());
  EXPECT_TRUE(Watch(job.name(), 0, &news).ok());
  EXPECT_EQ(supervisor_->List(10, "")->jobs.size(), 1u);
}

TEST_F(JobServicesTest, AWatcherThatLeavesDisturbsNobody) {
  Trainer(jobs::kRunsOn);
  const v1::Job job = TrainOverTheWire();
  {
    grpc::ClientContext context;
    v1::WatchJobRequest request;
    request.set_name(job.name());
    const auto reader = training_stub_->WatchJob(&context, request);
    v1::WatchJobResponse response;
    ASSERT_TRUE(reader->Read(&response));
    context.TryCancel();
    EXPECT_EQ(reader->Finish().error_code(), grpc::StatusCode::CANCELLED);
  }
  grpc::ClientContext context;
  v1::CancelJobRequest cancel;
  cancel.set_name(job.name());
  v1::Job cancelled;
  ASSERT_TRUE(training_stub_->CancelJob(&context, cancel, &cancelled).ok());
  std::vector<v1::Job> jobs;
  ASSERT_TRUE(Watch(job.name(), 0, &jobs).ok());
  EXPECT_EQ(jobs.back().state(), v1::JOB_STATE_CANCELLED);
}

TEST_F(JobServicesTest, WatchesEndWhenTheServerStops) {
  Trainer(jobs::kRunsOn);
  const v1::Job running = TrainOverTheWire();
  WaitForProgress(running.name());
  const v1::Job pending = TrainOverTheWire();
  std::vector<v1::Job> of_running;
  std::vector<v1::Job> of_pending;
  grpc::Status interrupted;
  grpc::Status cut_off;
  std::thread first([&] { interrupted = Watch(running.name(), 0, &of_running); });
  std::thread second([&] { cut_off = Watch(pending.name(), 0, &of_pending); });
  supervisor_->Stop();
  first.join();
  second.join();
  // Neither job has ended: both go on with the next start, and so may the watch.
  for (const grpc::Status& status : {interrupted, cut_off}) {
    EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE);
    EXPECT_EQ(Reason(status), "SERVER_STOPS");
  }
}

TEST_F(JobServicesTest, AWatcherThatNeverReadsDelaysNobodyElse) {
  // Some 10 MB of events: more than flow control lets through to somebody who takes none.
  Trainer(R"(i=0; usage=$(printf '0.125,%.0s' $(seq 200))
             while [ $i -lt 1000 ]; do i=$((i+1))
               echo "{\"phase\":\"joint\",\"epochReport\":{\"actionUsage\":[${usage%,}]}}"
             done
             mkdir "$output")");
  const v1::Job job = TrainOverTheWire();
  grpc::ClientContext context;
  v1::WatchJobRequest request;
  request.set_name(job.name());
  const auto idle = training_stub_->WatchJob(&context, request);
  EXPECT_EQ(WaitForEnd(job.name()).state(), v1::JOB_STATE_SUCCEEDED);
  std::vector<v1::Job> jobs;
  ASSERT_TRUE(Watch(job.name(), 0, &jobs).ok());
  ASSERT_EQ(jobs.size(), 1001u);
  // And the idle one still gets all of them, in order, once it reads.
  v1::WatchJobResponse response;
  int64_t count = 0;
  while (idle->Read(&response)) {
    ++count;
    EXPECT_EQ(response.job().progress().sequence(), std::min<int64_t>(count, 1000));
  }
  EXPECT_TRUE(idle->Finish().ok());
  EXPECT_EQ(count, 1001);
}

TEST_F(JobServicesTest, ResumesAFailedJobButNoSuccessfulOne) {
  Trainer("exit 73");
  const v1::Job job = TrainOverTheWire();
  WaitForEnd(job.name());
  Trainer("mkdir \"$output\"");
  const auto resume = [this](const std::string& name, v1::Job* answer) {
    grpc::ClientContext context;
    v1::ResumeJobRequest request;
    request.set_name(name);
    return training_stub_->ResumeJob(&context, request, answer);
  };
  v1::Job resumed;
  ASSERT_TRUE(resume(job.name(), &resumed).ok());
  EXPECT_EQ(resumed.state(), v1::JOB_STATE_PENDING);
  EXPECT_EQ(WaitForEnd(job.name()).state(), v1::JOB_STATE_SUCCEEDED);
  const grpc::Status again = resume(job.name(), &resumed);
  EXPECT_EQ(again.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(Reason(again), "JOB_NOT_RESUMABLE");
  EXPECT_EQ(Reason(resume("jobs/none", &resumed)), "JOB_NOT_FOUND");
  EXPECT_EQ(resume("none", &resumed).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(JobServicesTest, ListsJobsNewestFirstInPages) {
  std::vector<std::string> names;
  for (int i = 0; i < 3; ++i) names.push_back(TrainOverTheWire().name());
  v1::ListJobsRequest request;
  request.set_page_size(2);
  v1::ListJobsResponse page;
  grpc::ClientContext first;
  ASSERT_TRUE(training_stub_->ListJobs(&first, request, &page).ok());
  ASSERT_EQ(page.jobs_size(), 2);
  EXPECT_EQ(page.jobs(0).name(), names[2]);
  EXPECT_EQ(page.jobs(1).name(), names[1]);
  request.set_page_token(page.next_page_token());
  grpc::ClientContext second;
  ASSERT_TRUE(training_stub_->ListJobs(&second, request, &page).ok());
  ASSERT_EQ(page.jobs_size(), 1);
  EXPECT_EQ(page.jobs(0).name(), names[0]);
  request.set_page_token("not a token");
  grpc::ClientContext third;
  EXPECT_EQ(training_stub_->ListJobs(&third, request, &page).error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(JobServicesTest, ListsADamagedJobByItsNameAndItsError) {
  std::vector<std::string> names(4);
  for (std::string& name : names) {
    name = TrainOverTheWire().name();
    WaitForEnd(name);
  }
  DamageJob("UPDATE jobs SET job = x'00' WHERE name = '" + names[2] + "'");
  DamageJob("UPDATE jobs SET name = x'6a6fff' WHERE name = '" + names[1] + "'");
  grpc::ClientContext context;
  v1::ListJobsResponse page;
  const grpc::Status status = training_stub_->ListJobs(&context, {}, &page);
  ASSERT_TRUE(status.ok()) << status.error_message();
  ASSERT_EQ(page.jobs_size(), 4);
  EXPECT_EQ(page.jobs(0).name(), names[3]);
  EXPECT_EQ(page.jobs(0).state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(page.jobs(3).name(), names[0]);

  v1::Job damaged;
  damaged.set_name(names[2]);
  *damaged.mutable_error() = page.jobs(1).error();
  EXPECT_EQ(page.jobs(1).SerializeAsString(), damaged.SerializeAsString());
  EXPECT_THAT(page.jobs(1).error().message(), HasSubstr(names[2]));
  // A name that is no name, and no UTF-8.
  EXPECT_EQ(page.jobs(2).name(), "");
  EXPECT_THAT(page.jobs(2).error().message(), HasSubstr("jo\\xff"));
  for (const int place : {1, 2}) {
    const absl::Status error = errors::FromProto(page.jobs(place).error());
    EXPECT_TRUE(absl::IsDataLoss(error)) << error;
    EXPECT_EQ(errors::ReasonOf(error), "STORAGE_DAMAGED");
  }
}

TEST_F(JobServicesTest, ADamagedJobMakesNoDatasetAndNoTagsDamaged) {
  Trainer(jobs::kRunsOn);
  WaitForProgress(TrainOverTheWire().name());
  const std::string pending = TrainOverTheWire().name();
  DamageJob("UPDATE jobs SET job = x'00' WHERE name = '" + pending + "'");
  v1::DeleteDatasetRequest remove;
  remove.set_name("datasets/village");
  google::protobuf::Empty nothing;
  grpc::ClientContext context;
  const grpc::Status status = datasets_stub_->DeleteDataset(&context, remove, &nothing);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::DATA_LOSS);
  EXPECT_EQ(Reason(status), "STORAGE_DAMAGED");
  EXPECT_THAT(status.error_message(), HasSubstr(pending));
  EXPECT_EQ(errors::ReasonOf(supervisor_->DeleteTags("june")), "STORAGE_DAMAGED");
}

TEST_F(JobServicesTest, OnlyGetJobReturnsSampledExamples) {
  Trainer(R"(printf '{"examples":"1","sampledExamples":[{"scenarioId":"r0"}]}' > "$output")");
  v1::EvaluateRequest request;
  request.set_model("models/town");
  request.set_dataset("datasets/village");
  request.set_sampled_examples(1);
  grpc::ClientContext first;
  v1::Job job;
  ASSERT_TRUE(training_stub_->Evaluate(&first, request, &job).ok());
  const v1::Job ended = WaitForEnd(job.name());
  ASSERT_EQ(ended.evaluation().sampled_examples_size(), 1) << ended.DebugString();

  grpc::ClientContext second;
  v1::ListJobsResponse page;
  ASSERT_TRUE(training_stub_->ListJobs(&second, {}, &page).ok());
  ASSERT_EQ(page.jobs_size(), 1);
  EXPECT_EQ(page.jobs(0).evaluation().examples(), 1);
  EXPECT_EQ(page.jobs(0).evaluation().sampled_examples_size(), 0);
  grpc::ClientContext third;
  v1::GetJobRequest get;
  get.set_name(job.name());
  ASSERT_TRUE(training_stub_->GetJob(&third, get, &job).ok());
  EXPECT_EQ(job.evaluation().sampled_examples_size(), 1);
}

TEST_F(JobServicesTest, ARefusedTrainNamesTheWrongFields) {
  v1::TrainRequest request = TrainTown();
  request.set_model("town");
  grpc::ClientContext context;
  v1::Job job;
  const grpc::Status status = training_stub_->Train(&context, request, &job);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_details(), AllOf(HasSubstr("BadRequest"), HasSubstr("model")));
}

}  // namespace
}  // namespace maneuver::rpc::job_services_test
