// Tests what an operator sees of a real server: its metrics page and its log.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>
#include <vector>

#include "maneuver/v1/admin_service.grpc.pb.h"
#include "maneuver/v1/dataset_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "tests/integration/metrics_page.h"
#include "tests/integration/secured_server.h"

namespace maneuver::integration::observability_test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

constexpr char kTraceparent[] = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01";

class ObservabilityTest : public ::testing::Test {
 protected:
  ObservabilityTest() {
    token_ = folder_.CreateToken("operator", "predict,train,admin");
    server_ = folder_.Start({"--tokens", folder_.file("tokens").string(), "--log-format", "json"});
    channel_ = Connect(*server_, "");
    predictions_ = v1::PredictionService::NewStub(channel_);
  }

  void Introduce(grpc::ClientContext& context) const {
    context.AddMetadata("authorization", "Bearer " + token_);
  }

  int Command(std::vector<std::string> arguments, std::string* output) const {
    folder_.Write("operator.token", token_);
    arguments.insert(arguments.begin(), {"--token-file", folder_.file("operator.token").string()});
    return RunManeuver(*server_, arguments, output);
  }

  // Opens a stream for one request and returns its answer.
  v1::StreamPredictResponse StreamOnce(const v1::StreamPredictRequest& request) {
    grpc::ClientContext context;
    Introduce(context);
    const auto stream = predictions_->StreamPredict(&context);
    v1::StreamPredictResponse answer;
    EXPECT_TRUE(stream->Write(request));
    EXPECT_TRUE(stream->WritesDone());
    EXPECT_TRUE(stream->Read(&answer));
    v1::StreamPredictResponse none;
    EXPECT_FALSE(stream->Read(&none));
    EXPECT_TRUE(stream->Finish().ok());
    return answer;
  }

  // Stops the server and returns its log.
  std::string FinalLog() {
    predictions_.reset();
    channel_.reset();
    EXPECT_EQ(server_->Terminate(), 0);
    return folder_.log_text();
  }

  SecuredFolder folder_;
  std::string token_;
  std::unique_ptr<ServerProcess> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::PredictionService::Stub> predictions_;
};

// After an intended change, replace the golden page by the new one, as the failure says.
TEST_F(ObservabilityTest, TheMetricsPageHasTheExpectedNamesTypesLabelsAndHelp) {
  const std::string shape = ShapeOf(MetricsPage(*server_));
  ExpectShape(shape, GOLDEN_METRICS_PAGE, ACTUAL_METRICS_PAGE);
}

TEST_F(ObservabilityTest, TheMetricsPagePassesPromtool) {
  if (!HasPromtool()) GTEST_SKIP() << "promtool is not installed";
  ExpectPromtoolIsContent(MetricsPage(*server_), folder_.file("page"));
}

TEST_F(ObservabilityTest, CountsMessageBytesByMethod) {
  v1::PredictRequest request;
  request.add_scenarios()->set_scenario_id(std::string(1000, 'x'));
  {
    grpc::ClientContext context;
    Introduce(context);
    v1::PredictResponse response;
    EXPECT_FALSE(predictions_->Predict(&context, request, &response).ok());  // no model
  }
  v1::StreamPredictRequest item;
  item.set_request_id("a");
  *item.mutable_request() = request;
  const v1::StreamPredictResponse answer = StreamOnce(item);
  v1::GetLogLevelResponse level;
  {
    grpc::ClientContext context;
    Introduce(context);
    ASSERT_TRUE(v1::AdminService::NewStub(channel_)->GetLogLevel(&context, {}, &level).ok());
  }
  const auto bytes = [this](const std::string& way, const std::string& method) {
    return ValueOf(MetricsPage(*server_),
                   "maneuver_" + way + "_bytes_total{method=\"" + method + "\"}");
  };
  EXPECT_EQ(bytes("request", "PredictionService/Predict"), request.ByteSizeLong());
  EXPECT_EQ(bytes("response", "PredictionService/Predict"), 0);
  EXPECT_EQ(bytes("request", "PredictionService/StreamPredict"), item.ByteSizeLong());
  EXPECT_EQ(bytes("response", "PredictionService/StreamPredict"), answer.ByteSizeLong());
  EXPECT_EQ(bytes("request", "AdminService/GetLogLevel"), 0);
  EXPECT_EQ(bytes("response", "AdminService/GetLogLevel"), level.ByteSizeLong());
}

TEST_F(ObservabilityTest, TheLogLevelChangesWhileTheServerRuns) {
  const auto call = [this](const std::string& request_id) {
    grpc::ClientContext context;
    Introduce(context);
    context.AddMetadata("traceparent", kTraceparent);
    context.AddMetadata("x-request-id", request_id);
    v1::PredictResponse response;
    EXPECT_EQ(predictions_->Predict(&context, {}, &response).error_code(),
              grpc::StatusCode::INVALID_ARGUMENT);
    const auto& trailers = context.GetServerTrailingMetadata();
    const auto id = trailers.find("x-request-id");
    ASSERT_NE(id, trailers.end());
    EXPECT_EQ(std::string(id->second.data(), id->second.size()), request_id);
  };
  std::string output;
  call("before");
  EXPECT_EQ(Command({"log-level"}, &output), 0) << output;
  EXPECT_EQ(output, "info\n");
  EXPECT_EQ(Command({"log-level", "debug"}, &output), 0) << output;
  call("between");
  EXPECT_EQ(Command({"log-level", "warning"}, &output), 0) << output;
  EXPECT_EQ(output, "warning, before: debug\n");
  call("after");
  EXPECT_EQ(Command({"log-level", "loud"}, &output), 2);

  const std::string log = FinalLog();
  EXPECT_THAT(log, Not(HasSubstr("\"request_id\":\"before\"")));
  EXPECT_THAT(log, Not(HasSubstr("\"request_id\":\"after\"")));
  EXPECT_THAT(log, Not(HasSubstr("shutting down")));  // of level info
  EXPECT_THAT(log, HasSubstr("\"request_id\":\"between\",\"traceparent\":\"" +
                             std::string(kTraceparent) + "\"}\n"));
  EXPECT_THAT(log,
              HasSubstr("\"method\":\"PredictionService/Predict\",\"code\":\"INVALID_ARGUMENT\""));
  EXPECT_THAT(log,
              HasSubstr("\"message\":\"log level changed\",\"from\":\"info\",\"to\":\"debug\""));
}

TEST_F(ObservabilityTest, TheLogContainsNoPayloadsTokensOrPaths) {
  std::string output;
  ASSERT_EQ(Command({"log-level", "debug"}, &output), 0) << output;
  v1::StreamPredictRequest item;
  item.set_request_id("PAYLOAD-id");
  item.mutable_request()->set_model("models/payload-model");
  item.mutable_request()->add_scenarios()->set_scenario_id("PAYLOAD-scenario");
  StreamOnce(item);
  for (const char* authorization : {"Bearer PAYLOAD-token", "PAYLOAD-nothing"}) {
    grpc::ClientContext context;
    context.AddMetadata("authorization", authorization);
    context.AddMetadata("x-request-id", "PAYLOAD request");
    context.AddMetadata("traceparent", "PAYLOAD-trace");
    v1::PredictResponse response;
    EXPECT_EQ(predictions_->Predict(&context, item.request(), &response).error_code(),
              grpc::StatusCode::UNAUTHENTICATED);
  }
  EXPECT_NE(Command({"dataset", "describe", "PAYLOAD-data"}, &output), 0);
  EXPECT_NE(Command({"train", "town", "--dataset", "payload-none"}, &output), 0);

  const std::string log = FinalLog();
  EXPECT_THAT(log, HasSubstr("PredictionService/StreamPredict"));
  EXPECT_THAT(log, HasSubstr("TrainingService/Train"));
  EXPECT_THAT(log, Not(HasSubstr("PAYLOAD")));
  EXPECT_THAT(log, Not(HasSubstr("payload")));
  EXPECT_THAT(log, Not(HasSubstr(token_)));
  EXPECT_THAT(log, Not(HasSubstr(folder_.path().string())));
}

}  // namespace
}  // namespace maneuver::integration::observability_test
