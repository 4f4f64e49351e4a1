// maneuver::client: the C++ library for a Maneuver server.
//
//   #include <iostream>
//
//   #include "client/client.h"
//
//   // `scenario` has agents, map, prediction_time and target_ids.
//   int Ask(const maneuver::v1::Scenario& scenario) {
//     const auto client = maneuver::client::Client::Connect({.address = "127.0.0.1:8470"});
//     if (!client.ok()) return std::cerr << client.status() << "\n", 1;
//     maneuver::v1::PredictRequest request;
//     request.set_model("models/town");
//     *request.add_scenarios() = scenario;
//     const auto answer = (*client)->Predict(request);
//     if (!answer.ok()) return std::cerr << answer.status() << "\n", 1;
//     for (double p : answer->predictions(0).targets(0).probabilities()) std::cout << p << "\n";
//     return 0;
//   }
//
// In CMake: find_package(maneuver-client) and link maneuver::client.
//
// Every call takes a request as the contract (maneuver/v1/*.proto) states it and returns its
// response, or a status with the server's code and message and, by ErrorDetailsOf
// (error_details.h), the reason and the fields that are wrong. In a batch an item fails alone: look
// at `error` of each prediction.
//
// A server that asks who calls: set tls and token_file of ClientOptions.
//
// Each call has a deadline, over all its attempts. Calls that are safe to repeat are tried again
// when the server is UNAVAILABLE (retry.h): all but deletions; uploads go on where they were.
// Train, Evaluate and CrossValidate are safe because they carry a request_id; one is made up where
// the request has none.

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
#include "client/cancellation.h"
#include "client/predict_stream.h"
#include "client/prepared_prediction.h"
#include "client/retry.h"
#include "maneuver/v1/admin_service.pb.h"
#include "maneuver/v1/dataset_service.pb.h"
#include "maneuver/v1/model_service.pb.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::client {

// How long a call may take when CallOptions do not say.
struct CallDeadlines {
  absl::Duration prediction = absl::Seconds(30);
  absl::Duration management = absl::Seconds(60);  // all else but these:
  absl::Duration upload = absl::Hours(1);
};

// Encryption, and who is at the other end. Paths of PEM files.
struct TlsOptions {
  std::string root_certificates = "";  // whose servers are trusted; empty: the system's authorities
  std::string certificate = "";        // of this client, where the server asks for one
  std::string key = "";                // of that certificate
  std::string server_name = "";        // in the server's certificate; empty: the address's
};

struct ClientOptions {
  // HOST:PORT, or unix:PATH; HOST alone is at port 8470. Several servers that answer alike:
  // IP:PORT,IP:PORT, or dns:///NAME:PORT for all addresses of a name. Calls then go to them in
  // turn, predictions to those whose health says that a model is ready; what changes something
  // should name one server.
  std::string address = "127.0.0.1:8470";
  std::optional<TlsOptions> tls = {};  // nothing: plain text
  // Says who calls, where the server asks for that. Sent over TLS, or within this machine, alone.
  std::string token = "";
  std::string token_file = "";  // in place of `token`; read by Connect
  CallDeadlines deadlines = {};
  RetryPolicy retry = {};
  // StartPrediction is tried again as well, and by gRPC itself: as `retry` says, but five times at
  // most, and not while more than a few calls of late have failed.
  bool retry_started = false;
  // While the server refuses more than a sixth of the predictions for having too much to do, or has
  // no time for them before their deadlines, about a fifth more than it accepts are sent, so that
  // it is known when it has time again. The others fail at once with RESOURCE_EXHAUSTED, reason
  // kHeldBack. The server's time goes to those it can answer.
  bool hold_back = true;
  // An upload that broke off is gone on with for so long after the last sign of life.
  absl::Duration upload_patience = absl::Minutes(2);
  // A watched job whose stream broke is picked up again for so long after the last sign of life.
  absl::Duration watch_patience = absl::Minutes(1);
  OnRetry on_retry = {};        // told before each wait; may be empty
  std::string user_agent = "";  // goes before gRPC's own
  // Clients of the same address share one connection, where a server takes a limited number of
  // calls at once; the others wait. True: this one has its own.
  bool own_connection = false;
};

// Of one call.
struct CallOptions {
  std::optional<absl::Duration> timeout = {};  // in place of the kind's deadline
  Cancellation* cancellation = nullptr;        // not owned; outlives the call
};

// How far an upload or a download is, bytes of files.
struct UploadProgress {
  int64_t there = 0;    // at the other end, or on the way to it
  int64_t total = 0;    // of all files
  int64_t resumed = 0;  // of `there`: before this call
};

// A connection to one server, or to each of several. Thread-safe; calls run in the calling thread.
class Client {
 public:
  // INVALID_ARGUMENT for options that make no sense, NOT_FOUND for files that cannot be read,
  // FAILED_PRECONDITION for a token that would cross the network in plain text. Does not wait for
  // the server: the first call connects, and finds out whether it answers.
  static absl::StatusOr<std::unique_ptr<Client>> Connect(const ClientOptions& options);
  ~Client();
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  // Predictions. States after the prediction time are ignored by the server; StripFuture
  // (observed_scenario.h) saves sending them. ClassifyTrajectories needs them.
  absl::StatusOr<v1::PredictActionProbabilitiesResponse> PredictActionProbabilities(
      const v1::PredictActionProbabilitiesRequest& request, const CallOptions& call = {});
  absl::StatusOr<v1::PredictActionDistributionsResponse> PredictActionDistributions(
      const v1::PredictActionDistributionsRequest& request, const CallOptions& call = {});
  absl::StatusOr<v1::PredictResponse> Predict(const v1::PredictRequest& request,
                                              const CallOptions& call = {});
  absl::StatusOr<v1::ClassifyTrajectoriesResponse> ClassifyTrajectories(
      const v1::ClassifyTrajectoriesRequest& request, const CallOptions& call = {});
  // Starts a prediction and returns; of thousands under way none needs a thread of its own. Not
  // retried, unless ClientOptions::retry_started.
  //   on_answer: called once, on a thread of the client's own that all answers share: must not
  //     block, and may start predictions, but after CANCELLED. The client has to outlive it; its
  //     destructor cancels what is under way.
  void StartPrediction(const PreparedPrediction& request, OnPrediction on_answer,
                       const CallOptions& call = {});
  // Gives the server a map for scenarios that name it; MapReuse (map_reuse.h) does it by itself.
  absl::StatusOr<v1::RegisterMapResponse> RegisterMap(const v1::RegisterMapRequest& request,
                                                      const CallOptions& call = {});
  // For a loop: see predict_stream.h. The client has to outlive the stream.
  std::unique_ptr<PredictStream> StreamPredict(PredictStream::OnResponse on_response,
                                               const CallOptions& call = {});

  // Models.
  absl::StatusOr<v1::ListModelVersionsResponse> ListModelVersions(
      const v1::ListModelVersionsRequest& request, const CallOptions& call = {});
  absl::StatusOr<v1::ModelVersion> GetModelVersion(const v1::GetModelVersionRequest& request,
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

  using OnUploaded = std::function<void(const UploadProgress&)>;
  // Registers the folder's model.json, weights.safetensors and, where it has them, baselines as the
  // next version of `parent`, models/{model}; no alias points to it. Goes on where it broke off, as UploadDataset does. A
  // version of the model that has just these files is returned, and not made again.
  // NOT_FOUND, before anything is sent, if a file is missing; INVALID_ARGUMENT if the server cannot
  // serve the model.
  absl::StatusOr<v1::ModelVersion> UploadModelVersion(const std::string& folder,
                                                      const std::string& parent,
                                                      const OnUploaded& on_progress,
                                                      const CallOptions& call = {});
  // Writes the files of a version, as GetModelVersionRequest.name names it, into a new folder, and
  // checks their SHA-256. Returns the version's name. The folder appears once it is whole; until
  // then what has arrived lies beside it in .NAME.part, where the same call goes on after an error.
  // ALREADY_EXISTS if the folder exists and holds anything but this version; DATA_LOSS if a file
  // arrives altered.
  absl::StatusOr<std::string> DownloadModelVersion(const std::string& name,
                                                   const std::string& folder,
                                                   const OnUploaded& on_progress,
                                                   const CallOptions& call = {});

  // Datasets.
  // Uploads a folder with dataset.json and its shards as datasets/{dataset} `name`. Returns once it
  // is committed. What has arrived, by this call or an earlier one, is not sent again: a connection
  // that breaks is made anew and the upload goes on, and after an error the same call does.
  //   on_progress: once it is known what is there, and after each chunk; may be empty.
  // NOT_FOUND or DATA_LOSS, before anything is sent, if the folder is not whole; ABORTED if another
  // upload of the name by the same caller has begun meanwhile.
  absl::StatusOr<v1::Dataset> UploadDataset(const std::string& folder, const std::string& name,
                                            const OnUploaded& on_progress,
                                            const CallOptions& call = {});
  absl::StatusOr<v1::ListDatasetsResponse> ListDatasets(const v1::ListDatasetsRequest& request,
                                                        const CallOptions& call = {});
  absl::StatusOr<v1::Dataset> GetDataset(const v1::GetDatasetRequest& request,
                                         const CallOptions& call = {});
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
  absl::StatusOr<v1::Job> GetJob(const v1::GetJobRequest& request, const CallOptions& call = {});
  absl::StatusOr<v1::ListJobsResponse> ListJobs(const v1::ListJobsRequest& request,
                                                const CallOptions& call = {});
  absl::StatusOr<v1::Job> CancelJob(const v1::CancelJobRequest& request,
                                    const CallOptions& call = {});
  absl::StatusOr<v1::Job> ResumeJob(const v1::ResumeJobRequest& request,
                                    const CallOptions& call = {});
  absl::Status DeleteJob(const v1::DeleteJobRequest& request, const CallOptions& call = {});
  // Calls `on_event` with each event of a job after request.after_sequence, until the job ends or
  // `on_event` returns false; returns the job as it was last seen. Each event comes once: a broken
  // stream is picked up after the last one. Without CallOptions::timeout there is no deadline.
  absl::StatusOr<v1::Job> WatchJob(const v1::WatchJobRequest& request,
                                   const std::function<bool(const v1::Job&)>& on_event,
                                   const CallOptions& call = {});

  // For operators.
  absl::StatusOr<v1::GetLogLevelResponse> GetLogLevel(const v1::GetLogLevelRequest& request,
                                                      const CallOptions& call = {});
  absl::StatusOr<v1::SetLogLevelResponse> SetLogLevel(const v1::SetLogLevelRequest& request,
                                                      const CallOptions& call = {});

  // grpc.health.v1: OK if the service ("" is the whole server) is SERVING; UNAVAILABLE, with the
  // reason "NOT_SERVING" (ErrorDetailsOf), if it is not; NOT_FOUND if the server does not know it.
  // Not retried.
  absl::Status CheckHealth(const std::string& service = "", const CallOptions& call = {});

  const ClientOptions& options() const;

 private:
  struct Connection;
  explicit Client(std::unique_ptr<Connection> connection);

  const std::unique_ptr<Connection> connection_;
};

// Whether a job has ended: SUCCEEDED, FAILED or CANCELLED.
bool HasEnded(const v1::Job& job);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_CLIENT_H_
