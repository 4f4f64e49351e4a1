// maneuver::client: the C++ library for a Maneuver server.
//
//   #include <iostream>
//
//   #include "client/client.h"
//
//   // `scenario` has agents, map, prediction_time and target_ids.
//   int Ask(const maneuver::v1::Scenario& scenario) {
//     const auto client = maneuver::client::Client::Connect({.address = "127.0.0.1:8470"});
//     if (!client.ok()) return std::cerr << client.status().message() << "\n", 1;
//     maneuver::v1::PredictRequest request;
//     request.set_model("models/town");
//     *request.add_scenarios() = scenario;
//     const auto answer = (*client)->Predict(request);
//     if (!answer.ok()) return std::cerr << answer.status().message() << "\n", 1;
//     for (double p : answer->predictions(0).targets(0).probabilities()) std::cout << p << "\n";
//     return 0;
//   }
//
// In CMake: find_package(maneuver-client) and link maneuver::client.
//
// Every call takes a request of the contract (maneuver/v1/*.proto) and returns its response, or a
// status with the server's code and message. ErrorDetailsOf (error_details.h) reads the reason and
// the invalid fields from it. In a batch, items fail individually: check `error` of each
// prediction.
//
// If the server requires identities, set tls and token_file of ClientOptions.
//
// Each call has one deadline for all its attempts; WatchJob has none unless it is given, and streams
// have their own. Calls that are safe to repeat are retried when the server is UNAVAILABLE
// (retry.h): all except deletions, CollectOutcomes, CheckHealth, and StartPrediction unless
// ClientOptions::retry_started is set. Transfers continue where they stopped. Train, Evaluate,
// CrossValidate, Recalibrate, Tag and ReportOutcomes are safe because they carry a request_id; the
// client makes one if the request has none.

#ifndef MANEUVER_CLIENT_CLIENT_H_
#define MANEUVER_CLIENT_CLIENT_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/client_options.h"
#include "client/outcome_stream.h"
#include "client/predict_stream.h"
#include "client/prepared_prediction.h"
#include "maneuver/v1/admin_service.pb.h"
#include "maneuver/v1/dataset_service.pb.h"
#include "maneuver/v1/model_service.pb.h"
#include "maneuver/v1/outcome_service.pb.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/replica_service.pb.h"
#include "maneuver/v1/tag_service.pb.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::client {

struct Connection;

// A connection to one server, or to several. Thread-safe; calls block the calling thread.
class Client {
 public:
  // Creates a client. INVALID_ARGUMENT for invalid options, NOT_FOUND for files that cannot be
  // read, FAILED_PRECONDITION for a token that would cross the network unencrypted. Does not wait
  // for the server: the first call connects and finds out whether it answers.
  static absl::StatusOr<std::unique_ptr<Client>> Connect(const ClientOptions& options);
  ~Client();
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  // Predictions. The server ignores states after the prediction time; StripFuture
  // (observed_scenario.h) avoids sending them. ClassifyTrajectories needs them.
  absl::StatusOr<v1::PredictActionProbabilitiesResponse> PredictActionProbabilities(
      const v1::PredictActionProbabilitiesRequest& request, const CallOptions& call = {});
  absl::StatusOr<v1::PredictActionDistributionsResponse> PredictActionDistributions(
      const v1::PredictActionDistributionsRequest& request, const CallOptions& call = {});
  absl::StatusOr<v1::PredictResponse> Predict(const v1::PredictRequest& request,
                                              const CallOptions& call = {});
  absl::StatusOr<v1::ClassifyTrajectoriesResponse> ClassifyTrajectories(
      const v1::ClassifyTrajectoriesRequest& request, const CallOptions& call = {});
  // Starts a prediction and returns. Thousands may be in progress without a thread for each.
  // Retried only with ClientOptions::retry_started.
  //   on_answer: called once, on a thread that all answers of this client share. It must not block.
  //     It may start predictions, except after CANCELLED. The client must outlive the call; its
  //     destructor cancels calls in progress.
  void StartPrediction(const PreparedPrediction& request, OnPrediction on_answer,
                       const CallOptions& call = {});
  // Registers a map for scenarios that name it. MapReuse (map_reuse.h) does so automatically.
  absl::StatusOr<v1::RegisterMapResponse> RegisterMap(const v1::RegisterMapRequest& request,
                                                      const CallOptions& call = {});
  // Opens a stream for a control loop: see predict_stream.h. The client must outlive it.
  std::unique_ptr<PredictStream> StreamPredict(PredictStream::OnResponse on_response,
                                               const CallOptions& call = {});

  // Reports what happened after predictions. The server counts a report once, even if it is sent
  // again.
  absl::StatusOr<v1::ReportOutcomesResponse> ReportOutcomes(
      const v1::ReportOutcomesRequest& request, const CallOptions& call = {});
  // Opens a stream for many reports: see outcome_stream.h. The client must outlive it.
  //   call.timeout: the longest wait for one answer; by default as for ReportOutcomes
  std::unique_ptr<OutcomeStream> StreamOutcomes(OutcomeStream::OnAnswer on_answer,
                                                const CallOptions& call = {});
  // Makes a dataset of the outcomes that the server collected; the default deadline is that of
  // uploads. Not retried: a server that lost its answer may have made the dataset.
  absl::StatusOr<v1::CollectOutcomesResponse> CollectOutcomes(
      const v1::CollectOutcomesRequest& request, const CallOptions& call = {});

  // Models.
  absl::StatusOr<v1::ListModelVersionsResponse> ListModelVersions(
      const v1::ListModelVersionsRequest& request, const CallOptions& call = {});
  absl::StatusOr<v1::ModelVersion> GetModelVersion(const v1::GetModelVersionRequest& request,
                                                   const CallOptions& call = {});
  // Lists the servers that share a store, with the versions that each has loaded.
  absl::StatusOr<v1::ListReplicasResponse> ListReplicas(const v1::ListReplicasRequest& request = {},
                                                        const CallOptions& call = {});
  absl::Status DeleteModelVersion(const v1::DeleteModelVersionRequest& request,
                                  const CallOptions& call = {});
  absl::StatusOr<v1::ModelAlias> SetModelAlias(const v1::SetModelAliasRequest& request,
                                               const CallOptions& call = {});
  absl::Status DeleteModelAlias(const v1::DeleteModelAliasRequest& request,
                                const CallOptions& call = {});
  absl::StatusOr<v1::ActionSet> GetActionSet(const v1::GetActionSetRequest& request,
                                             const CallOptions& call = {});
  absl::StatusOr<v1::Action> LabelAction(const v1::LabelActionRequest& request,
                                         const CallOptions& call = {});
  absl::StatusOr<v1::ListEvaluationReportsResponse> ListEvaluationReports(
      const v1::ListEvaluationReportsRequest& request, const CallOptions& call = {});
  absl::StatusOr<v1::EvaluationReport> GetEvaluationReport(
      const v1::GetEvaluationReportRequest& request, const CallOptions& call = {});

  using OnUploaded = client::OnUploaded;
  // Registers the folder's model.json, weights.safetensors and, if it has them, baselines as the
  // next version of `parent`, models/{model}. No alias points to the new version. An interrupted
  // upload continues where it stopped, as in UploadDataset. If the model already has a version with
  // exactly these files, returns that version and makes no other. NOT_FOUND, before anything is
  // sent, if a file is missing; INVALID_ARGUMENT if the server cannot serve the model.
  absl::StatusOr<v1::ModelVersion> UploadModelVersion(const std::string& folder,
                                                      const std::string& parent,
                                                      const OnUploaded& on_progress,
                                                      const CallOptions& call = {});
  // Writes the files of a version, named as in GetModelVersionRequest.name, into a new folder, and
  // checks their SHA-256. Returns the version's name. The folder appears only once it is complete.
  // Until then the bytes lie beside it in .NAME.part; after an error, the same call continues from
  // there. ALREADY_EXISTS if the folder exists and holds anything but this version; DATA_LOSS if a
  // file arrives altered.
  absl::StatusOr<std::string> DownloadModelVersion(const std::string& name,
                                                   const std::string& folder,
                                                   const OnUploaded& on_progress,
                                                   const CallOptions& call = {});

  // Datasets.
  // Uploads a folder with dataset.json and its shards as datasets/{dataset} `name`. Returns once it
  // is committed. Bytes that arrived earlier, by this call or a previous one, are not sent again.
  // After a broken connection the upload continues by itself; after an error, the same call
  // continues it.
  //   on_progress: called once it is known what has arrived, and after each chunk; may be empty.
  // NOT_FOUND or DATA_LOSS, before anything is sent, if the folder is incomplete; ABORTED if the
  // same caller has begun another upload of this name meanwhile.
  absl::StatusOr<v1::Dataset> UploadDataset(const std::string& folder, const std::string& name,
                                            const OnUploaded& on_progress,
                                            const CallOptions& call = {});
  // Makes a folder on the server's disk a dataset in place. The server reads all of it first, so
  // the default deadline is that of uploads.
  absl::StatusOr<v1::Dataset> RegisterDataset(const v1::RegisterDatasetRequest& request,
                                              const CallOptions& call = {});
  absl::StatusOr<v1::ListDatasetsResponse> ListDatasets(const v1::ListDatasetsRequest& request,
                                                        const CallOptions& call = {});
  absl::StatusOr<v1::Dataset> GetDataset(const v1::GetDatasetRequest& request,
                                         const CallOptions& call = {});
  // Counts what is in a dataset. The server reads all of it, once, so the default deadline is that
  // of uploads.
  absl::StatusOr<v1::DatasetSummary> DescribeDataset(const v1::DescribeDatasetRequest& request,
                                                     const CallOptions& call = {});
  absl::Status DeleteDataset(const v1::DeleteDatasetRequest& request, const CallOptions& call = {});
  absl::StatusOr<v1::ListScenariosResponse> ListScenarios(const v1::ListScenariosRequest& request,
                                                          const CallOptions& call = {});
  absl::StatusOr<v1::Scenario> GetScenario(const v1::GetScenarioRequest& request,
                                           const CallOptions& call = {});

  // Jobs.
  absl::StatusOr<v1::Job> Train(const v1::TrainRequest& request, const CallOptions& call = {});
  absl::StatusOr<v1::Job> Evaluate(const v1::EvaluateRequest& request,
                                   const CallOptions& call = {});
  absl::StatusOr<v1::Job> CrossValidate(const v1::CrossValidateRequest& request,
                                        const CallOptions& call = {});
  absl::StatusOr<v1::Job> Recalibrate(const v1::RecalibrateRequest& request,
                                      const CallOptions& call = {});
  absl::StatusOr<v1::Job> Tag(const v1::TagRequest& request, const CallOptions& call = {});
  absl::StatusOr<v1::Job> GetJob(const v1::GetJobRequest& request, const CallOptions& call = {});
  // Of a job whose record on the server is damaged, only name and error are set.
  absl::StatusOr<v1::ListJobsResponse> ListJobs(const v1::ListJobsRequest& request,
                                                const CallOptions& call = {});
  absl::StatusOr<v1::Job> CancelJob(const v1::CancelJobRequest& request,
                                    const CallOptions& call = {});
  absl::StatusOr<v1::Job> ResumeJob(const v1::ResumeJobRequest& request,
                                    const CallOptions& call = {});
  absl::Status DeleteJob(const v1::DeleteJobRequest& request, const CallOptions& call = {});
  // Calls `on_event` with each event of a job after request.after_sequence, until the job ends or
  // `on_event` returns false. Returns the job's latest state. Each event arrives once: a broken
  // stream continues after the last event. Without CallOptions::timeout there is no deadline.
  absl::StatusOr<v1::Job> WatchJob(const v1::WatchJobRequest& request,
                                   const std::function<bool(const v1::Job&)>& on_event,
                                   const CallOptions& call = {});

  // Tags, which jobs of Tag make.
  absl::StatusOr<v1::ListTagsResponse> ListTags(const v1::ListTagsRequest& request,
                                                const CallOptions& call = {});
  absl::StatusOr<v1::Tags> GetTags(const v1::GetTagsRequest& request, const CallOptions& call = {});
  // Writes the files of tags/{tags} `name` into a new folder, as DownloadModelVersion does. Returns
  // the name. Only shards that are complete are sent.
  absl::StatusOr<std::string> DownloadTags(const std::string& name, const std::string& folder,
                                           const OnUploaded& on_progress,
                                           const CallOptions& call = {});
  absl::Status DeleteTags(const v1::DeleteTagsRequest& request, const CallOptions& call = {});

  // Return and change the lowest level that the server logs. For operators.
  absl::StatusOr<v1::GetLogLevelResponse> GetLogLevel(const v1::GetLogLevelRequest& request,
                                                      const CallOptions& call = {});
  absl::StatusOr<v1::SetLogLevelResponse> SetLogLevel(const v1::SetLogLevelRequest& request,
                                                      const CallOptions& call = {});

  // Asks grpc.health.v1. OK if the service ("" is the whole server) is SERVING; UNAVAILABLE with
  // the reason "NOT_SERVING" (ErrorDetailsOf) if it is not; NOT_FOUND if the server does not know
  // it. Not retried.
  absl::Status CheckHealth(const std::string& service = "", const CallOptions& call = {});

  const ClientOptions& options() const;

 private:
  explicit Client(std::unique_ptr<Connection> connection);

  const std::unique_ptr<Connection> connection_;
};

// Returns whether a job has ended: SUCCEEDED, FAILED or CANCELLED.
bool HasEnded(const v1::Job& job);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_CLIENT_H_
