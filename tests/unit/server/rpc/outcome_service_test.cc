#include "server/rpc/outcome_service.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "tests/unit/server/rpc/server_fixture.h"

namespace maneuver::rpc::outcome_service_test {
namespace {

// A server of outcomes beside the fixture's.
class OutcomeServiceTest : public ServerTest {
 protected:
  //   most_waiting: reports that may wait for the one thread
  void Start(size_t most_waiting, const security::AccessOptions& access = {}) {
    outcome_access_ = *security::AccessControl::Create(access, *metrics_);
    outcome_context_ = std::make_unique<PredictionContext>(PredictionContext{
        *models_, *scheduler_, maps_, send_memory_, *disk_, {}, *outcome_access_});
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

  // Reports one outcome of an answer that is not kept.
  grpc::Status Report(v1::ReportOutcomesResponse* response) {
    v1::ReportOutcomesRequest request;
    v1::Outcome& outcome = *request.add_outcomes();
    outcome.set_scenario_id("nowhere");
    outcome.add_targets()->set_target_id(7);
    grpc::ClientContext context;
    return outcome_stub_->ReportOutcomes(&context, request, response);
  }

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

}  // namespace
}  // namespace maneuver::rpc::outcome_service_test
