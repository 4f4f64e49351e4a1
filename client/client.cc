#include "client/client.h"

#include <grpcpp/generic/generic_stub.h>

#include <future>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/connection.h"
#include "client/credentials.h"
#include "client/request_id.h"
#include "client/server_address.h"
#include "client/service_config.h"
#include "google/protobuf/wrappers.pb.h"

namespace maneuver::client {
namespace {

constexpr int kMostKeptForRetry = 64 << 20;  // bytes of one request

template <typename Empty>
absl::Status StatusOnly(const absl::StatusOr<Empty>& response) {
  return response.status();
}

}  // namespace

absl::StatusOr<std::unique_ptr<Client>> Client::Connect(const ClientOptions& options) {
  const auto address = ParseServerAddress(options.address);
  if (!address.ok()) return address.status();
  const RetryPolicy& retry = options.retry;
  if (retry.max_attempts < 1 || retry.initial_backoff < absl::ZeroDuration() ||
      retry.backoff_multiplier < 1.0 || !(retry.jitter >= 0.0 && retry.jitter <= 1.0)) {
    return absl::InvalidArgumentError(
        "retry needs max_attempts >= 1, initial_backoff >= 0, backoff_multiplier >= 1 and jitter "
        "in [0, 1]");
  }
  grpc::ChannelArguments arguments;
  // Scenes and answers may be large; the server decides how large.
  arguments.SetMaxReceiveMessageSize(-1);
  arguments.SetMaxSendMessageSize(-1);
  // Connects again as soon as a retry needs a connection.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  // This is also the timeout of an attempt to connect.
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, 5'000);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 2'000);
  // Finds out, while calls are in flight, that the server went without a word.
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, 60'000);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 20'000);
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);  // gRPC would stop after two
  // gRPC would connect to a local server through the proxy that http_proxy names: another machine,
  // which cannot reach the server, and which must not read a token.
  if (IsLocal(options.address)) arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  if (options.own_connection) arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  if (!options.user_agent.empty()) arguments.SetUserAgentPrefix(options.user_agent);

  if (options.tls && !options.tls->server_name.empty()) {
    arguments.SetSslTargetNameOverride(options.tls->server_name);
  }

  auto credentials = LoadCredentials(options);
  if (!credentials.ok()) return credentials.status();
  const auto channel = [&](const ServiceConfig& config, bool retries) {
    grpc::ChannelArguments own = arguments;
    // This library retries the other calls itself.
    own.SetInt(GRPC_ARG_ENABLE_RETRIES, retries ? 1 : 0);
    if (retries) {
      // gRPC keeps what it may send again; requests often exceed its default of 256 KiB.
      own.SetInt(GRPC_ARG_PER_RPC_RETRY_BUFFER_SIZE, kMostKeptForRetry);
    }
    const std::string json = ToJson(config);
    if (!json.empty()) own.SetServiceConfigJSON(json);
    return grpc::CreateCustomChannel(address->target, credentials->channel, own);
  };

  auto connection = std::make_unique<Connection>();
  connection->options = options;
  connection->authorization = std::move(credentials->authorization);
  ServiceConfig config{.several = address->several};
  connection->channel = channel(config, false);
  std::shared_ptr<grpc::Channel> predicting = connection->channel;
  if (address->several) {
    config.health_service = v1::PredictionService::service_full_name();
    predicting = channel(config, false);
  }
  std::shared_ptr<grpc::Channel> started = predicting;
  if (options.retry_started) {
    config.retry = options.retry;
    started = channel(config, true);
  }
  connection->predictions = v1::PredictionService::NewStub(predicting);
  connection->outcomes = v1::OutcomeService::NewStub(connection->channel);
  connection->models = v1::ModelService::NewStub(connection->channel);
  connection->datasets = v1::DatasetService::NewStub(connection->channel);
  connection->training = v1::TrainingService::NewStub(connection->channel);
  connection->tags = v1::TagService::NewStub(connection->channel);
  connection->pending = std::make_unique<PendingPredictions>(started);
  connection->replicas = v1::ReplicaService::NewStub(connection->channel);
  connection->admin = v1::AdminService::NewStub(connection->channel);
  return std::unique_ptr<Client>(new Client(std::move(connection)));
}

Client::Client(std::unique_ptr<Connection> connection) : connection_(std::move(connection)) {}
Client::~Client() = default;

const ClientOptions& Client::options() const { return connection_->options; }

// One line per call: stub, method, whether it may be repeated, and its default deadline.
#define MANEUVER_CALL(stub, Service, Method, repeatable, deadline)                       \
  connection_->Call(*connection_->stub, &v1::Service::Stub::Method, request, repeatable, \
                    connection_->options.deadlines.deadline, call)
// A prediction. The server may be asked for more of these than it can answer.
#define MANEUVER_PREDICTION(Method) \
  connection_->Predict(&v1::PredictionService::Stub::Method, request, call)

absl::StatusOr<v1::PredictActionProbabilitiesResponse> Client::PredictActionProbabilities(
    const v1::PredictActionProbabilitiesRequest& request, const CallOptions& call) {
  return MANEUVER_PREDICTION(PredictActionProbabilities);
}

absl::StatusOr<v1::PredictActionDistributionsResponse> Client::PredictActionDistributions(
    const v1::PredictActionDistributionsRequest& request, const CallOptions& call) {
  return MANEUVER_PREDICTION(PredictActionDistributions);
}

absl::StatusOr<v1::PredictResponse> Client::Predict(const v1::PredictRequest& request,
                                                    const CallOptions& call) {
  return MANEUVER_PREDICTION(Predict);
}

absl::StatusOr<v1::ClassifyTrajectoriesResponse> Client::ClassifyTrajectories(
    const v1::ClassifyTrajectoriesRequest& request, const CallOptions& call) {
  return MANEUVER_PREDICTION(ClassifyTrajectories);
}

void Client::StartPrediction(const PreparedPrediction& request, OnPrediction on_answer,
                             const CallOptions& call) {
  auto pending = std::make_unique<PendingPredictions::Call>();
  const absl::Duration timeout = call.timeout.value_or(connection_->options.deadlines.prediction);
  pending->message = request.message_;
  pending->on_answer = std::move(on_answer);
  const absl::Status admitted = connection_->Admit(timeout);
  if (!admitted.ok()) {
    connection_->pending->Refuse(std::move(pending), admitted);
    return;
  }
  connection_->Introduce(pending->context);
  pending->context.set_deadline(absl::ToChronoTime(absl::Now() + timeout));
  pending->on_end = [this, timeout](const absl::Status& status) {
    connection_->Record(status, timeout);
  };
  connection_->pending->Start(std::move(pending), call.cancellation);
}

absl::StatusOr<v1::RegisterMapResponse> Client::RegisterMap(const v1::RegisterMapRequest& request,
                                                            const CallOptions& call) {
  return MANEUVER_CALL(predictions, PredictionService, RegisterMap, Repeatable::kYes, prediction);
}

absl::StatusOr<v1::ReportOutcomesResponse> Client::ReportOutcomes(
    const v1::ReportOutcomesRequest& without_id, const CallOptions& call) {
  const v1::ReportOutcomesRequest request = WithRequestId(without_id);
  return MANEUVER_CALL(outcomes, OutcomeService, ReportOutcomes, Repeatable::kYes, management);
}

absl::StatusOr<v1::CollectOutcomesResponse> Client::CollectOutcomes(
    const v1::CollectOutcomesRequest& request, const CallOptions& call) {
  return MANEUVER_CALL(outcomes, OutcomeService, CollectOutcomes, Repeatable::kNo, upload);
}

absl::StatusOr<v1::ListModelVersionsResponse> Client::ListModelVersions(
    const v1::ListModelVersionsRequest& request, const CallOptions& call) {
  return MANEUVER_CALL(models, ModelService, ListModelVersions, Repeatable::kYes, management);
}

absl::StatusOr<v1::ModelVersion> Client::GetModelVersion(const v1::GetModelVersionRequest& request,
                                                         const CallOptions& call) {
  return MANEUVER_CALL(models, ModelService, GetModelVersion, Repeatable::kYes, management);
}

absl::StatusOr<v1::ListReplicasResponse> Client::ListReplicas(
    const v1::ListReplicasRequest& request, const CallOptions& call) {
  return MANEUVER_CALL(replicas, ReplicaService, ListReplicas, Repeatable::kYes, management);
}

absl::Status Client::DeleteModelVersion(const v1::DeleteModelVersionRequest& request,
                                        const CallOptions& call) {
  return StatusOnly(
      MANEUVER_CALL(models, ModelService, DeleteModelVersion, Repeatable::kNo, management));
}

absl::StatusOr<v1::ModelAlias> Client::SetModelAlias(const v1::SetModelAliasRequest& request,
                                                     const CallOptions& call) {
  return MANEUVER_CALL(models, ModelService, SetModelAlias, Repeatable::kYes, management);
}

absl::Status Client::DeleteModelAlias(const v1::DeleteModelAliasRequest& request,
                                      const CallOptions& call) {
  return StatusOnly(
      MANEUVER_CALL(models, ModelService, DeleteModelAlias, Repeatable::kNo, management));
}

absl::StatusOr<v1::ActionSet> Client::GetActionSet(const v1::GetActionSetRequest& request,
                                                   const CallOptions& call) {
  return MANEUVER_CALL(models, ModelService, GetActionSet, Repeatable::kYes, management);
}

absl::StatusOr<v1::Action> Client::LabelAction(const v1::LabelActionRequest& request,
                                               const CallOptions& call) {
  return MANEUVER_CALL(models, ModelService, LabelAction, Repeatable::kYes, management);
}

absl::StatusOr<v1::ListEvaluationReportsResponse> Client::ListEvaluationReports(
    const v1::ListEvaluationReportsRequest& request, const CallOptions& call) {
  return MANEUVER_CALL(models, ModelService, ListEvaluationReports, Repeatable::kYes, management);
}

absl::StatusOr<v1::EvaluationReport> Client::GetEvaluationReport(
    const v1::GetEvaluationReportRequest& request, const CallOptions& call) {
  return MANEUVER_CALL(models, ModelService, GetEvaluationReport, Repeatable::kYes, management);
}

absl::StatusOr<v1::Dataset> Client::RegisterDataset(const v1::RegisterDatasetRequest& request,
                                                    const CallOptions& call) {
  return MANEUVER_CALL(datasets, DatasetService, RegisterDataset, Repeatable::kYes, upload);
}

absl::StatusOr<v1::ListDatasetsResponse> Client::ListDatasets(
    const v1::ListDatasetsRequest& request, const CallOptions& call) {
  return MANEUVER_CALL(datasets, DatasetService, ListDatasets, Repeatable::kYes, management);
}

absl::StatusOr<v1::Dataset> Client::GetDataset(const v1::GetDatasetRequest& request,
                                               const CallOptions& call) {
  return MANEUVER_CALL(datasets, DatasetService, GetDataset, Repeatable::kYes, management);
}

absl::StatusOr<v1::DatasetSummary> Client::DescribeDataset(
    const v1::DescribeDatasetRequest& request, const CallOptions& call) {
  return MANEUVER_CALL(datasets, DatasetService, DescribeDataset, Repeatable::kYes, upload);
}

absl::Status Client::DeleteDataset(const v1::DeleteDatasetRequest& request,
                                   const CallOptions& call) {
  return StatusOnly(
      MANEUVER_CALL(datasets, DatasetService, DeleteDataset, Repeatable::kNo, management));
}

absl::StatusOr<v1::ListScenariosResponse> Client::ListScenarios(
    const v1::ListScenariosRequest& request, const CallOptions& call) {
  return MANEUVER_CALL(datasets, DatasetService, ListScenarios, Repeatable::kYes, management);
}

absl::StatusOr<v1::Scenario> Client::GetScenario(const v1::GetScenarioRequest& request,
                                                 const CallOptions& call) {
  return MANEUVER_CALL(datasets, DatasetService, GetScenario, Repeatable::kYes, management);
}

absl::StatusOr<v1::Job> Client::Train(const v1::TrainRequest& without_id, const CallOptions& call) {
  const v1::TrainRequest request = WithRequestId(without_id);
  return MANEUVER_CALL(training, TrainingService, Train, Repeatable::kYes, management);
}

absl::StatusOr<v1::Job> Client::Evaluate(const v1::EvaluateRequest& without_id,
                                         const CallOptions& call) {
  const v1::EvaluateRequest request = WithRequestId(without_id);
  return MANEUVER_CALL(training, TrainingService, Evaluate, Repeatable::kYes, management);
}

absl::StatusOr<v1::Job> Client::CrossValidate(const v1::CrossValidateRequest& without_id,
                                              const CallOptions& call) {
  const v1::CrossValidateRequest request = WithRequestId(without_id);
  return MANEUVER_CALL(training, TrainingService, CrossValidate, Repeatable::kYes, management);
}

absl::StatusOr<v1::Job> Client::Recalibrate(const v1::RecalibrateRequest& without_id,
                                            const CallOptions& call) {
  const v1::RecalibrateRequest request = WithRequestId(without_id);
  return MANEUVER_CALL(training, TrainingService, Recalibrate, Repeatable::kYes, management);
}

absl::StatusOr<v1::Job> Client::Tag(const v1::TagRequest& without_id, const CallOptions& call) {
  const v1::TagRequest request = WithRequestId(without_id);
  return MANEUVER_CALL(training, TrainingService, Tag, Repeatable::kYes, management);
}

absl::StatusOr<v1::Job> Client::GetJob(const v1::GetJobRequest& request, const CallOptions& call) {
  return MANEUVER_CALL(training, TrainingService, GetJob, Repeatable::kYes, management);
}

absl::StatusOr<v1::ListJobsResponse> Client::ListJobs(const v1::ListJobsRequest& request,
                                                      const CallOptions& call) {
  return MANEUVER_CALL(training, TrainingService, ListJobs, Repeatable::kYes, management);
}

absl::StatusOr<v1::Job> Client::CancelJob(const v1::CancelJobRequest& request,
                                          const CallOptions& call) {
  return MANEUVER_CALL(training, TrainingService, CancelJob, Repeatable::kYes, management);
}

absl::StatusOr<v1::Job> Client::ResumeJob(const v1::ResumeJobRequest& request,
                                          const CallOptions& call) {
  return MANEUVER_CALL(training, TrainingService, ResumeJob, Repeatable::kYes, management);
}

absl::Status Client::DeleteJob(const v1::DeleteJobRequest& request, const CallOptions& call) {
  return StatusOnly(
      MANEUVER_CALL(training, TrainingService, DeleteJob, Repeatable::kNo, management));
}

absl::StatusOr<v1::ListTagsResponse> Client::ListTags(const v1::ListTagsRequest& request,
                                                      const CallOptions& call) {
  return MANEUVER_CALL(tags, TagService, ListTags, Repeatable::kYes, management);
}

absl::StatusOr<v1::Tags> Client::GetTags(const v1::GetTagsRequest& request,
                                         const CallOptions& call) {
  return MANEUVER_CALL(tags, TagService, GetTags, Repeatable::kYes, management);
}

absl::Status Client::DeleteTags(const v1::DeleteTagsRequest& request, const CallOptions& call) {
  return StatusOnly(MANEUVER_CALL(tags, TagService, DeleteTags, Repeatable::kNo, management));
}

absl::StatusOr<v1::GetLogLevelResponse> Client::GetLogLevel(const v1::GetLogLevelRequest& request,
                                                            const CallOptions& call) {
  return MANEUVER_CALL(admin, AdminService, GetLogLevel, Repeatable::kYes, management);
}

absl::StatusOr<v1::SetLogLevelResponse> Client::SetLogLevel(const v1::SetLogLevelRequest& request,
                                                            const CallOptions& call) {
  return MANEUVER_CALL(admin, AdminService, SetLogLevel, Repeatable::kYes, management);
}

#undef MANEUVER_CALL

absl::Status Client::CheckHealth(const std::string& service, const CallOptions& call) {
  // Has the same bytes as grpc.health.v1.HealthCheckRequest {string service = 1} and
  // HealthCheckResponse {enum status = 1}; distributions do not ship health.proto.
  grpc::TemplatedGenericStub<google::protobuf::StringValue, google::protobuf::Int32Value> stub(
      connection_->channel);
  grpc::ClientContext context;
  connection_->Introduce(context);
  context.set_deadline(absl::ToChronoTime(
      absl::Now() + call.timeout.value_or(connection_->options.deadlines.management)));
  const Cancellation::Registration registration(call.cancellation,
                                                [&context] { context.TryCancel(); });
  google::protobuf::StringValue request;
  request.set_value(service);
  google::protobuf::Int32Value response;
  std::promise<grpc::Status> done;
  stub.UnaryCall(&context, "/grpc.health.v1.Health/Check", {}, &request, &response,
                 [&done](grpc::Status status) { done.set_value(std::move(status)); });
  absl::Status status = ToStatus(done.get_future().get());
  if (!status.ok()) return status;
  constexpr int kServing = 1;
  if (response.value() == kServing) return absl::OkStatus();
  return WithDetails(absl::UnavailableError(absl::StrCat(service.empty() ? "the server" : service,
                                                         " is not ready to serve")),
                     {.reason = "NOT_SERVING"});
}

bool HasEnded(const v1::Job& job) {
  return job.state() == v1::JOB_STATE_SUCCEEDED || job.state() == v1::JOB_STATE_FAILED ||
         job.state() == v1::JOB_STATE_CANCELLED;
}

}  // namespace maneuver::client
