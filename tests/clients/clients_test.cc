// Tests the contract with clients that we did not write. Each asks a real server for its health and
// for a prediction, and must get the same answer as our own stubs.

#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "model/artifact/model_folder.h"
#include "tests/integration/metrics_page.h"
#include "tests/integration/server_process.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/model/inference/reference_model.h"

namespace maneuver::integration {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

// Runs a program, which is found on the PATH as in a shell.
int RunClient(std::vector<std::string> command, std::string* output) {
  command.insert(command.begin(), "/usr/bin/env");
  return Run(command, output);
}

v1::PredictRequest RecordedRequest() {
  std::ostringstream json;
  json << std::ifstream(CLIENTS "/request.json").rdbuf();
  v1::PredictRequest request;
  EXPECT_TRUE(google::protobuf::util::JsonStringToMessage(json.str(), &request).ok());
  return request;
}

// Returns a message in gRPC's frame: not compressed, length, bytes.
std::string Framed(const google::protobuf::MessageLite& message) {
  const std::string bytes = message.SerializeAsString();
  std::string framed(1, '\0');
  for (int shift = 24; shift >= 0; shift -= 8) {
    framed += static_cast<char>(bytes.size() >> shift & 0xff);
  }
  return framed + bytes;
}

// A server with one small model of random weights, which serves.
class ClientsTest : public ::testing::Test {
 protected:
  ClientsTest() {
    const fs::path data = folder_.path() / "data";
    fs::create_directories(data / "models" / "tiny");
    const auto written = artifact::WriteModelFolder(
        data / "models" / "tiny" / "1", inference::RandomModel(artifact::TinySpec(), 1));
    EXPECT_TRUE(written.ok()) << written;
    server_ = std::make_unique<ServerProcess>(data);
    v1::SetModelAliasRequest alias;
    alias.set_name("models/tiny/aliases/serving");
    alias.set_model_version("models/tiny/versions/1");
    grpc::ClientContext context;
    v1::ModelAlias set;
    const auto status =
        v1::ModelService::NewStub(server_->channel())->SetModelAlias(&context, alias, &set);
    EXPECT_TRUE(status.ok()) << status.error_message();
  }

  std::string File(const std::string& name, const std::string& content) const {
    const fs::path file = folder_.path() / name;
    std::ofstream(file, std::ios::binary) << content;
    return file.string();
  }

  // Compares the last line that a client printed with the answers that our stubs get.
  void ExpectRightAnswers(const std::string& output) {
    const size_t start = output.rfind("{\"health\"");
    ASSERT_NE(start, std::string::npos) << output;
    const nlohmann::json answer = nlohmann::json::parse(output.substr(start));
    EXPECT_EQ(answer["health"], "SERVING");
    EXPECT_EQ(answer["model_version"], "models/tiny/versions/1");
    EXPECT_EQ(answer["error"]["code"], "NOT_FOUND");
    EXPECT_EQ(answer["error"]["reason"], "MODEL_NOT_FOUND");
    grpc::ClientContext context;
    v1::PredictResponse response;
    const auto status = v1::PredictionService::NewStub(server_->channel())
                            ->Predict(&context, RecordedRequest(), &response);
    ASSERT_TRUE(status.ok()) << status.error_message();
    const auto& expected = response.predictions(0).targets(0).probabilities();
    ASSERT_EQ(expected.size(), 3);
    EXPECT_THAT(answer["probabilities"].get<std::vector<double>>(),
                ::testing::Pointwise(::testing::DoubleNear(1e-12), expected));
  }

  TemporaryFolder folder_;
  std::unique_ptr<ServerProcess> server_;
};

TEST_F(ClientsTest, PythonsGrpcio) {
  std::string output;
  ASSERT_EQ(RunClient({"/usr/bin/python3", CLIENTS "/predict.py", server_->address()}, &output), 0)
      << output;
  ExpectRightAnswers(output);
}

TEST_F(ClientsTest, NodesGrpcJs) {
  std::string output;
  const std::string modules = "cd " CLIENTS
                              " && node -e 'require(\"@grpc/grpc-js\"); "
                              "require(\"@grpc/proto-loader\"); require(\"protobufjs\")'";
  if (RunClient({"/bin/sh", "-c", modules}, &output) != 0)
    GTEST_SKIP() << "see tests/clients/README.md";
  ASSERT_EQ(RunClient({"node", CLIENTS "/predict.cjs", server_->address()}, &output), 0) << output;
  ExpectRightAnswers(output);
}

// h2load does not read gRPC's trailers, so the server's counters show that the calls succeeded.
TEST_F(ClientsTest, H2loadWithARecordedBody) {
  const auto load = [this](const std::string& method, const std::string& body) {
    std::string output;
    EXPECT_EQ(RunClient({"h2load", "-n200", "-c2", "-m10", "-d", body, "-H",
                         "content-type: application/grpc", "-H", "te: trailers",
                         "http://" + server_->address() + method},
                        &output),
              0);
    EXPECT_THAT(output, HasSubstr("200 done, 200 succeeded, 0 failed, 0 errored, 0 timeout"));
  };
  load("/maneuver.v1.PredictionService/Predict", File("predict", Framed(RecordedRequest())));
  load("/grpc.health.v1.Health/Check", File("check", std::string(5, '\0')));  // an empty message
  const std::string page = MetricsPage(*server_);
  for (const char* method : {"PredictionService/Predict", "Health/Check"}) {
    EXPECT_EQ(ValueOf(page, "maneuver_requests_total{code=\"OK\",method=\"" + std::string(method) +
                                "\"}"),
              200.0)
        << method;
  }
}

}  // namespace
}  // namespace maneuver::integration
