#include "server/rpc/outcome_service.h"

#include <gmock/gmock.h>

#include <atomic>
#include <cstdint>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/errors/error_details.h"
#include "server/rpc/recent_reports.h"
#include "tests/unit/server/rpc/server_fixture.h"

namespace maneuver::rpc::outcome_service_test {
namespace {

using ::testing::HasSubstr;

// A server of outcomes beside the fixture's.
class OutcomeServiceTest : public ServerTest {
 protected:
  //   most_waiting: reports that may wait for the one thread
  void Start(size_t most_waiting, const security::AccessOptions& access = {}) {
    outcome_access_ = *security::AccessControl::Create(access, *metrics_);
    outcome_context_ = std::make_unique<PredictionContext>(PredictionContext{
        *models_, *scheduler_, maps_, outcome_memory_, *disk_, *loading_, {}, *outcome_access_});
    scoring_ = std::make_unique<WorkerPool>(1, most_waiting);
    outcomes_ = std::make_unique<OutcomeService>(*outcome_context_, outcome_metrics_, *scoring_);
    auto server = Server::Start({"127.0.0.1", 0},
                                {{v1::OutcomeService::service_full_name(), outcomes_.get()}},
                                *outcome_access_, *metrics_);
    ASSERT_TRUE(server.ok()) << server.status();
    outcome_server_ = *std::move(server);
    outcome_stub_ = v1::OutcomeService::NewStub(grpc::CreateChannel(
        outcome_server_->address().ToString(), grpc::InsecureChannelCredentials()));
  }
  void TearDown() override {
    outcome_server_ = nullptr;
    scoring_ = nullptr;
    ServerTest::TearDown();
  }

  // Returns a report of one outcome of an answer that is not kept.
  static v1::ReportOutcomesRequest UnknownAnswer(const std::string& request_id = "") {
    v1::ReportOutcomesRequest request;
    request.set_request_id(request_id);
    v1::Outcome& outcome = *request.add_outcomes();
    outcome.set_scenario_id("nowhere");
    outcome.add_targets()->set_target_id(7);
    return request;
  }
  grpc::Status Report(v1::ReportOutcomesResponse* response, const std::string& request_id = "") {
    grpc::ClientContext context;
    return outcome_stub_->ReportOutcomes(&context, UnknownAnswer(request_id), response);
  }
  // Sends a report twice on one stream, and returns both answers.
  std::vector<v1::StreamOutcomesResponse> ReportTwiceOnAStream(const std::string& request_id = "") {
    grpc::ClientContext context;
    const auto stream = outcome_stub_->StreamOutcomes(&context);
    v1::StreamOutcomesRequest request;
    *request.mutable_report() = UnknownAnswer(request_id);
    std::vector<v1::StreamOutcomesResponse> answers(2);
    for (v1::StreamOutcomesResponse& answer : answers) {
      EXPECT_TRUE(stream->Write(request));
      EXPECT_TRUE(stream->Read(&answer));
    }
    stream->WritesDone();
    EXPECT_TRUE(stream->Finish().ok());
    return answers;
  }
  // Returns how many targets were counted: each is of an answer that is not kept.
  double Counted() const {
    const std::string page = metrics_->Page();
    const std::string name = "maneuver_outcome_targets_total{result=\"unknown\"} ";
    return std::stod(page.substr(page.find(name) + name.size()));
  }

  std::atomic<int64_t> used_ = 0;  // of 1000 bytes
  serving::MemoryBudget budget_{1000, [this] { return used_.load(); }, [] {}, *metrics_};
  serving::SendMemory outcome_memory_{
      {.max_response_bytes = 1 << 20, .max_send_memory = 8 << 20}, *metrics_, &budget_};
  std::unique_ptr<security::AccessControl> outcome_access_;
  std::unique_ptr<PredictionContext> outcome_context_;
  serving::OutcomeMetrics outcome_metrics_{*metrics_};
  std::unique_ptr<WorkerPool> scoring_;
  std::unique_ptr<OutcomeService> outcomes_;
  std::unique_ptr<Server> outcome_server_;
  std::unique_ptr<v1::OutcomeService::Stub> outcome_stub_;
};

TEST_F(OutcomeServiceTest, AnswersFromItsThread) {
  Start(1);
  v1::ReportOutcomesResponse response;
  const grpc::Status status = Report(&response);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(response.scores(0).targets(0).error().code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(OutcomeServiceTest, RefusesAReportWithADelayWhenTooManyWait) {
  Start(0);
  v1::ReportOutcomesResponse response;
  const grpc::Status status = Report(&response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(Reason(status), "TOO_MANY_REQUESTS");
  EXPECT_NE(status.error_details().find("google.rpc.RetryInfo"), std::string::npos);
}

TEST_F(OutcomeServiceTest, UnreadAnswersRefuseReportsWithoutCountingThem) {
  Start(1);
  v1::ReportOutcomesResponse response;
  {
    const serving::SendMemory::Share unread = outcome_memory_.Take(8 << 20);
    EXPECT_EQ(Reason(Report(&response)), "SEND_MEMORY_FULL");
    for (const v1::StreamOutcomesResponse& answer : ReportTwiceOnAStream()) {
      EXPECT_EQ(answer.error().code(), static_cast<int>(grpc::StatusCode::RESOURCE_EXHAUSTED));
    }
  }
  EXPECT_EQ(Counted(), 0.0);
  EXPECT_TRUE(Report(&response).ok());
  EXPECT_FALSE(ReportTwiceOnAStream().back().has_error());
  // The end of a call is seen by its caller before it is by the server.
  while (SendMemory() > 0.0) std::this_thread::yield();
}

TEST_F(OutcomeServiceTest, TargetsCountAgainstTheCallersLimit) {
  security::AccessOptions access;
  access.targets_per_second = 1e-3;
  Start(1, access);
  v1::ReportOutcomesResponse response;
  Report(&response);  // uses up what may come at once
  const grpc::Status status = Report(&response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(Reason(status), "RATE_LIMITED");
}

TEST_F(OutcomeServiceTest, AReportThatIsSentAgainIsCountedOnceAndGetsTheSameAnswer) {
  Start(1);
  v1::ReportOutcomesResponse first;
  ASSERT_TRUE(Report(&first, "a").ok());
  EXPECT_EQ(Counted(), 1.0);
  v1::ReportOutcomesResponse again;
  ASSERT_TRUE(Report(&again, "a").ok());
  EXPECT_EQ(Counted(), 1.0);
  EXPECT_EQ(again.SerializeAsString(), first.SerializeAsString());
  // A stream knows what arrived in a call.
  grpc::ClientContext context;
  const auto stream = outcome_stub_->StreamOutcomes(&context);
  v1::StreamOutcomesRequest request;
  *request.mutable_report() = UnknownAnswer("a");
  ASSERT_TRUE(stream->Write(request));
  v1::StreamOutcomesResponse answer;
  ASSERT_TRUE(stream->Read(&answer));
  EXPECT_EQ(answer.response().SerializeAsString(), first.SerializeAsString());
  EXPECT_EQ(Counted(), 1.0);
  stream->WritesDone();
  EXPECT_TRUE(stream->Finish().ok());
  // Another report is another one, whatever it is called; and so is one without a name.
  grpc::ClientContext other_context;
  v1::ReportOutcomesRequest other = UnknownAnswer("a");
  other.mutable_outcomes(0)->mutable_targets(0)->set_target_id(8);
  ASSERT_TRUE(outcome_stub_->ReportOutcomes(&other_context, other, &again).ok());
  EXPECT_EQ(again.scores(0).targets(0).target_id(), 8);
  EXPECT_EQ(Counted(), 2.0);
  ASSERT_TRUE(Report(&again).ok());
  ASSERT_TRUE(Report(&again).ok());
  EXPECT_EQ(Counted(), 4.0);
}

TEST_F(OutcomeServiceTest, AStreamAnswersEachReportInItsOrder) {
  Start(1);
  grpc::ClientContext context;
  const auto stream = outcome_stub_->StreamOutcomes(&context);
  std::vector<v1::StreamOutcomesRequest> requests(5);
  *requests[0].mutable_report() = UnknownAnswer("a");
  requests[1].mutable_report()->set_request_id("without outcomes");
  *requests[2].mutable_report() = UnknownAnswer(std::string(129, 'x'));
  for (int i = 0; i < 257; ++i) requests[3].mutable_report()->add_outcomes()->add_targets();
  *requests[4].mutable_report() = UnknownAnswer("e");
  for (const v1::StreamOutcomesRequest& request : requests) ASSERT_TRUE(stream->Write(request));
  stream->WritesDone();
  std::vector<v1::StreamOutcomesResponse> answers;
  for (v1::StreamOutcomesResponse answer; stream->Read(&answer);) answers.push_back(answer);
  EXPECT_TRUE(stream->Finish().ok());
  ASSERT_EQ(answers.size(), requests.size());
  EXPECT_EQ(answers[0].request_id(), "a");
  EXPECT_EQ(answers[0].response().scores(0).targets(0).error().code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(answers[1].request_id(), "without outcomes");
  for (const size_t refused : {1, 2, 3}) {
    EXPECT_EQ(answers[refused].error().code(), grpc::StatusCode::INVALID_ARGUMENT);
  }
  EXPECT_THAT(answers[2].error().message(), HasSubstr("request_id"));
  EXPECT_THAT(answers[3].error().message(), HasSubstr("at most 256"));
  EXPECT_EQ(answers[4].request_id(), "e");
  EXPECT_EQ(Counted(), 2.0);
}

TEST_F(OutcomeServiceTest, AStreamRefusesWhatIsNoReportAndGoesOn) {
  Start(1);
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  const auto done = [&queue] {
    void* tag = nullptr;
    bool ok = false;
    return queue.Next(&tag, &ok) && ok;
  };
  grpc::GenericStub stub(grpc::CreateChannel(outcome_server_->address().ToString(),
                                             grpc::InsecureChannelCredentials()));
  auto stream = stub.PrepareCall(&context, "/maneuver.v1.OutcomeService/StreamOutcomes", &queue);
  stream->StartCall(nullptr);
  ASSERT_TRUE(done());
  v1::StreamOutcomesRequest good;
  *good.mutable_report() = UnknownAnswer("good");
  for (const std::string& bytes :
       {std::string("\x0a\x7f\x01"), std::string("\xff\xff\xff\xff"),
        // A request_id that is not UTF-8.
        std::string("\x0a\x04\x1a\x02\xff\xfe"), good.SerializeAsString()}) {
    const grpc::Slice slice(bytes);
    stream->Write(grpc::ByteBuffer(&slice, 1), nullptr);
    ASSERT_TRUE(done());
    grpc::ByteBuffer answer;
    stream->Read(&answer, nullptr);
    ASSERT_TRUE(done());
    v1::StreamOutcomesResponse response;
    ASSERT_TRUE(
        grpc::SerializationTraits<v1::StreamOutcomesResponse>::Deserialize(&answer, &response)
            .ok());
    const bool is_good = bytes == good.SerializeAsString();
    EXPECT_EQ(response.request_id(), is_good ? "good" : "");
    EXPECT_EQ(errors::ReasonOf(errors::FromProto(response.error())),
              is_good ? "" : "MALFORMED_MESSAGE");
  }
  EXPECT_EQ(Counted(), 1.0);
  context.TryCancel();
  grpc::Status status;
  stream->Finish(&status, nullptr);
  done();
}

TEST_F(OutcomeServiceTest, AStreamRefusesReportsWhenTooManyWaitAndGoesOn) {
  Start(0);
  for (const v1::StreamOutcomesResponse& answer : ReportTwiceOnAStream("a")) {
    EXPECT_EQ(answer.error().code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_EQ(answer.request_id(), "a");
  }
}

TEST_F(OutcomeServiceTest, AStreamRefusesReportsWhileTheMemoryIsNearlyFull) {
  Start(1);
  grpc::ClientContext context;
  const auto stream = outcome_stub_->StreamOutcomes(&context);
  const auto report = [&](v1::StreamOutcomesResponse* answer) {
    v1::StreamOutcomesRequest request;
    *request.mutable_report() = UnknownAnswer("a");
    ASSERT_TRUE(stream->Write(request));
    ASSERT_TRUE(stream->Read(answer));
  };
  v1::StreamOutcomesResponse answer;
  report(&answer);
  EXPECT_TRUE(answer.has_response());
  used_ = 900;
  budget_.Relieve();
  report(&answer);
  EXPECT_EQ(errors::ReasonOf(errors::FromProto(answer.error())), "MEMORY_FULL");
  EXPECT_EQ(answer.request_id(), "a");
  stream->WritesDone();
  EXPECT_TRUE(stream->Finish().ok());
}

TEST_F(OutcomeServiceTest, EachReportOfAStreamCountsAgainstTheCallersLimit) {
  security::AccessOptions access;
  access.targets_per_second = 1e-3;
  Start(1, access);
  const auto answers = ReportTwiceOnAStream();
  EXPECT_TRUE(answers[0].has_response());
  EXPECT_EQ(answers[1].error().code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
}

TEST_F(OutcomeServiceTest, AStreamEndsWithTheServerOnceItsReportIsAnswered) {
  Start(4);
  v1::StreamOutcomesRequest request;
  *request.mutable_report() = UnknownAnswer();
  v1::StreamOutcomesResponse answer;
  grpc::ClientContext idle_context;
  const auto idle = outcome_stub_->StreamOutcomes(&idle_context);
  ASSERT_TRUE(idle->Write(request));
  ASSERT_TRUE(idle->Read(&answer));
  // The thread that scores is busy: this report is accepted, and answered before the end.
  std::promise<void> gate;
  ASSERT_TRUE(scoring_->Post([free = gate.get_future().share()] { free.wait(); }));
  grpc::ClientContext busy_context;
  const auto busy = outcome_stub_->StreamOutcomes(&busy_context);
  ASSERT_TRUE(busy->Write(request));
  while (!outcomes_->HasReports()) std::this_thread::yield();
  outcomes_->Drain();
  EXPECT_FALSE(idle->Read(&answer));
  EXPECT_EQ(Reason(idle->Finish()), "SHUTTING_DOWN");
  gate.set_value();
  ASSERT_TRUE(busy->Read(&answer));
  EXPECT_EQ(answer.response().scores_size(), 1);
  EXPECT_FALSE(busy->Read(&answer));
  EXPECT_EQ(Reason(busy->Finish()), "SHUTTING_DOWN");
  grpc::ClientContext late_context;
  const auto late = outcome_stub_->StreamOutcomes(&late_context);
  EXPECT_FALSE(late->Read(&answer));
  EXPECT_EQ(Reason(late->Finish()), "SHUTTING_DOWN");
}

TEST(RecentReportsTest, TheOldestAnswersMakeRoom) {
  RecentReports recent(2000);
  v1::ReportOutcomesResponse answer;
  answer.add_scores()->mutable_error()->set_message(std::string(200, 'x'));
  for (const char* name : {"a", "b", "c", "d"}) recent.Keep(name, answer);
  v1::ReportOutcomesResponse found;
  EXPECT_FALSE(recent.Find("a", &found));
  EXPECT_TRUE(recent.Find("b", &found));
  EXPECT_EQ(found.SerializeAsString(), answer.SerializeAsString());
  EXPECT_TRUE(recent.Find("d", &found));
  answer.mutable_scores(0)->mutable_error()->set_message(std::string(3000, 'x'));
  recent.Keep("larger than all", answer);
  EXPECT_FALSE(recent.Find("d", &found));
  EXPECT_FALSE(recent.Find("larger than all", &found));
}

}  // namespace
}  // namespace maneuver::rpc::outcome_service_test
