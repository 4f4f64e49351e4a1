// The whole server over loopback, with networks that cost nothing.

#ifndef MANEUVER_TESTS_UNIT_SERVER_RPC_SERVER_FIXTURE_H_
#define MANEUVER_TESTS_UNIT_SERVER_RPC_SERVER_FIXTURE_H_

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "server/monitoring/prometheus_metrics.h"
#include "server/rpc/model_service.h"
#include "server/rpc/prediction_service.h"
#include "server/rpc/server.h"
#include "server/security/access_control.h"
#include "server/security/secret_file.h"
#include "tests/unit/server/serving/fake_action_model.h"
#include "tests/unit/server/serving/memory_alias_store.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::rpc {

// Returns the ErrorInfo of a failed call; the reason "no details" if it has none.
inline v1::ErrorInfo InfoOf(const grpc::Status& status) {
  v1::Status details;
  v1::ErrorInfo info;
  if (!details.ParseFromString(status.error_details())) info.set_reason("no details");
  for (const auto& any : details.details()) {
    if (any.type_url() == "type.googleapis.com/google.rpc.ErrorInfo") {
      info.ParseFromString(any.value());
    }
  }
  return info;
}
inline std::string Reason(const grpc::Status& status) { return InfoOf(status).reason(); }

inline v1::Scenario Scene() {
  v1::Scenario scenario;
  v1::Agent* agent = scenario.add_agents();
  agent->set_id(7);
  agent->set_type(v1::AGENT_TYPE_VEHICLE);
  agent->set_length(4);
  agent->set_width(2);
  agent->add_states()->set_x(100.0);
  scenario.add_target_ids(7);
  return scenario;
}

inline v1::PredictRequest OneScene() {
  v1::PredictRequest request;
  *request.add_scenarios() = Scene();
  return request;
}

class ServerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto versions = serving::VersionStore::Open(folder_ / "models");
    ASSERT_TRUE(versions.ok()) << versions.status();
    versions_ = *std::move(versions);
    auto models = serving::ServingTable::Open(
        *versions_, aliases_,
        [this](const std::filesystem::path&)
            -> absl::StatusOr<std::shared_ptr<const inference::ActionModel>> {
          return std::make_shared<serving::FakeActionModel>(networks_);
        },
        {.max_unaliased_in_memory = 0}, *metrics_);
    ASSERT_TRUE(models.ok()) << models.status();
    models_ = *std::move(models);
    scheduler_ = std::make_unique<serving::BatchScheduler>(
        serving::SchedulerOptions{.workers = 2, .queue = {.max_queue = 100}}, *metrics_);
    disk_ = std::make_unique<WorkerPool>(2, 100);
    loading_ = std::make_unique<WorkerPool>(1, 100);
    context_ = std::make_unique<PredictionContext>(PredictionContext{*models_,
                                                                     *scheduler_,
                                                                     maps_,
                                                                     send_memory_,
                                                                     *disk_,
                                                                     *loading_,
                                                                     {.map_by_id = true},
                                                                     *access_});
    predictions_ = std::make_unique<PredictionService>(*context_);
    version_uploads_ = std::make_unique<serving::VersionUploads>(folder_ / "models", *versions_,
                                                                 *models_, std::chrono::hours(1));
    model_service_ = std::make_unique<ModelService>(*versions_, *models_, *version_uploads_,
                                                    BlockingWork{*disk_, send_memory_}, *access_);
    auto server = Server::Start({"127.0.0.1", 0},
                                {{v1::PredictionService::service_full_name(), predictions_.get()},
                                 {v1::ModelService::service_full_name(), model_service_.get()}},
                                *access_, *metrics_);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
    models_->OnReadyChange([this](bool ready) { server_->SetPredictionsReady(ready); });
    channel_ =
        grpc::CreateChannel(server_->address().ToString(), grpc::InsecureChannelCredentials());
    stub_ = v1::PredictionService::NewStub(channel_);
    model_stub_ = v1::ModelService::NewStub(channel_);
  }

  // Starts another server of the predictions, closed_, which knows no caller.
  void StartClosed() {
    ASSERT_TRUE(security::AppendLine(folder_ / "tokens", "# nobody\n").ok());
    auto nobody = security::AccessControl::Create({.identities = folder_ / "tokens"}, *metrics_);
    ASSERT_TRUE(nobody.ok()) << nobody.status();
    nobody_ = *std::move(nobody);
    auto closed = Server::Start({"127.0.0.1", 0},
                                {{v1::PredictionService::service_full_name(), predictions_.get()}},
                                *nobody_, *metrics_);
    ASSERT_TRUE(closed.ok()) << closed.status();
    closed_ = *std::move(closed);
  }

  void TearDown() override {
    networks_.OpenGate();
    closed_ = nullptr;
    if (server_ != nullptr) server_->Shutdown(std::chrono::system_clock::now());
    server_ = nullptr;
    loading_ = nullptr;
    disk_ = nullptr;
    scheduler_ = nullptr;
  }

  void Publish(const std::string& model = "town") {
    const std::filesystem::path finished = folder_ / "finished";
    std::filesystem::create_directories(finished);
    std::ofstream(finished / "weights.safetensors") << "x";
    const auto name = models_->Publish(model, finished, v1::PROMOTION_UNSPECIFIED);
    ASSERT_TRUE(name.ok()) << name.status();
  }

  grpc::Status Predict(const v1::PredictRequest& request, v1::PredictResponse* response) {
    grpc::ClientContext context;
    return stub_->Predict(&context, request, response);
  }

  // Returns the metric: bytes of answers that their callers have not taken.
  double SendMemory() const {
    const std::string page = metrics_->Page();
    const std::string name = "\nmaneuver_send_memory_bytes ";
    return std::stod(page.substr(page.find(name) + name.size()));
  }

  // Makes a unary call with any bytes as its request.
  static grpc::Status CallWithBytes(const std::shared_ptr<grpc::Channel>& channel,
                                    const std::string& method, const std::string& bytes,
                                    grpc::ByteBuffer* answer) {
    const grpc::Slice slice(bytes);
    const grpc::ByteBuffer request(&slice, 1);
    grpc::ClientContext context;
    grpc::Status status;
    grpc::CompletionQueue queue;
    auto call = grpc::GenericStub(channel).PrepareUnaryCall(&context, method, request, &queue);
    call->StartCall();
    call->Finish(answer, &status, nullptr);
    void* tag = nullptr;
    bool ok = false;
    queue.Next(&tag, &ok);
    return status;
  }

  // Returns the answer of grpc.health.v1: 1 is SERVING, 2 is NOT_SERVING; -1 if the call fails.
  int Health(const std::string& service) {
    std::string request = "\x0a";
    request += static_cast<char>(service.size());
    request += service;
    grpc::ByteBuffer answer;
    const grpc::Status status =
        CallWithBytes(channel_, "/grpc.health.v1.Health/Check", request, &answer);
    grpc::Slice bytes;
    if (!status.ok() || !answer.DumpToSingleSlice(&bytes).ok() || bytes.size() != 2) return -1;
    return bytes.begin()[1];
  }

  const TemporaryFolder folder_;
  const std::unique_ptr<monitoring::PrometheusMetrics> metrics_ =
      monitoring::PrometheusMetrics::Create();
  const std::unique_ptr<security::AccessControl> access_ =
      *security::AccessControl::Create({}, *metrics_);
  serving::MemoryAliasStore aliases_;
  serving::FakeNetworks networks_;
  std::unique_ptr<serving::VersionStore> versions_;
  std::unique_ptr<serving::ServingTable> models_;
  std::unique_ptr<serving::VersionUploads> version_uploads_;
  serving::SendMemory send_memory_{{.max_response_bytes = 1 << 20, .max_send_memory = 8 << 20},
                                   *metrics_};
  std::unique_ptr<serving::BatchScheduler> scheduler_;
  serving::MapCache maps_{{.max_maps = 2}, *metrics_};
  std::unique_ptr<WorkerPool> disk_;
  std::unique_ptr<WorkerPool> loading_;
  std::unique_ptr<PredictionContext> context_;
  std::unique_ptr<PredictionService> predictions_;
  std::unique_ptr<ModelService> model_service_;
  std::unique_ptr<Server> server_;
  std::unique_ptr<security::AccessControl> nobody_;  // of closed_
  std::unique_ptr<Server> closed_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::PredictionService::Stub> stub_;
  std::unique_ptr<v1::ModelService::Stub> model_stub_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_TESTS_UNIT_SERVER_RPC_SERVER_FIXTURE_H_
