// Private to the library: the channel, the stubs, and the code that makes calls.

#ifndef MANEUVER_CLIENT_CONNECTION_H_
#define MANEUVER_CLIENT_CONNECTION_H_

#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>
#include <utility>

#include "absl/time/clock.h"
#include "client/call_status.h"
#include "client/client_options.h"
#include "client/overload_throttle.h"
#include "client/pending_predictions.h"
#include "maneuver/v1/admin_service.grpc.pb.h"
#include "maneuver/v1/dataset_service.grpc.pb.h"
#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/outcome_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "maneuver/v1/replica_service.grpc.pb.h"
#include "maneuver/v1/tag_service.grpc.pb.h"
#include "maneuver/v1/training_service.grpc.pb.h"

namespace maneuver::client {

enum class Repeatable { kNo, kYes };

struct Connection {
  ClientOptions options;
  std::string authorization;  // see ClientCredentials
  std::shared_ptr<grpc::Channel> channel;
  std::unique_ptr<v1::PredictionService::Stub> predictions;
  std::unique_ptr<v1::OutcomeService::Stub> outcomes;
  std::unique_ptr<v1::ModelService::Stub> models;
  std::unique_ptr<v1::DatasetService::Stub> datasets;
  std::unique_ptr<v1::TrainingService::Stub> training;
  std::unique_ptr<v1::ReplicaService::Stub> replicas;
  std::unique_ptr<v1::TagService::Stub> tags;
  std::unique_ptr<v1::AdminService::Stub> admin;
  OverloadThrottle throttle;
  std::unique_ptr<PendingPredictions> pending;  // last: destroyed before what it uses

  // Adds the caller's identity. Every call needs it before it starts.
  void Introduce(grpc::ClientContext& context) const {
    if (!authorization.empty()) context.AddMetadata("authorization", authorization);
  }

  // Decides whether a prediction is sent, and records how it ended. See OverloadThrottle.
  absl::Status Admit(absl::Duration timeout) {
    return options.hold_back ? throttle.Admit(timeout, absl::Now()) : absl::OkStatus();
  }
  void Record(const absl::Status& status, absl::Duration timeout) {
    throttle.Record(status, timeout, absl::Now());
  }

  template <typename Request, typename Response>
  absl::StatusOr<Response> Predict(grpc::Status (v1::PredictionService::Stub::*method)(
                                       grpc::ClientContext*, const Request&, Response*),
                                   const Request& request, const CallOptions& call) {
    const absl::Duration timeout = call.timeout.value_or(options.deadlines.prediction);
    const absl::Status admitted = Admit(timeout);
    if (!admitted.ok()) return admitted;
    auto response = Call(*predictions, method, request, Repeatable::kYes, timeout, call);
    Record(response.status(), timeout);
    return response;
  }

  // Makes a unary call until it succeeds or may not be repeated.
  template <typename Stub, typename Request, typename Response>
  absl::StatusOr<Response> Call(Stub& stub,
                                grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&,
                                                             Response*),
                                const Request& request, Repeatable repeatable,
                                absl::Duration default_timeout, const CallOptions& call) {
    const absl::Time deadline = absl::Now() + call.timeout.value_or(default_timeout);
    RetryPolicy policy = options.retry;
    if (repeatable == Repeatable::kNo) policy.max_attempts = 1;
    Response response;
    absl::Status status =
        RetryUnavailable(policy, deadline, call.cancellation, options.on_retry, [&] {
          grpc::ClientContext context;
          Introduce(context);
          context.set_deadline(absl::ToChronoTime(deadline));
          const Cancellation::Registration registration(call.cancellation,
                                                        [&context] { context.TryCancel(); });
          response.Clear();
          return ToRetriable((stub.*method)(&context, request, &response), call.cancellation);
        });
    if (!status.ok()) return status;
    return response;
  }
};

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_CONNECTION_H_
