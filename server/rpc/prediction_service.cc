#include "server/rpc/prediction_service.h"

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"
#include "server/rpc/blocking_call.h"
#include "server/rpc/grpc_internals.h"
#include "server/rpc/guarded_service.h"
#include "server/rpc/predict_stream.h"
#include "server/rpc/prediction_admission.h"
#include "server/rpc/status_details.h"

namespace maneuver::rpc {
namespace {

// As they came over the wire; in memory it is about twice as much.
int64_t Bytes(const google::protobuf::Message& request) {
  return static_cast<int64_t>(request.ByteSizeLong());
}

// Lives until gRPC is done with the call.
class PredictionReactor final : public InlineReactor<grpc::ServerUnaryReactor> {
 public:
  PredictionReactor(PredictionContext& context, grpc::CallbackServerContext& rpc,
                    const PredictionIo& io) {
    if (context.access.limits_targets()) {
      const absl::Status admitted = AdmitTargets(context.access, CredentialsOf(rpc), *io.scenarios);
      if (!admitted.ok()) {
        rpc.GetRpcAllocatorState()->FreeRequest();
        Finish(ToGrpcStatus(admitted));
        return;
      }
    }
    auto request = context.shadow == nullptr ? nullptr : KeepRequest(rpc.GetRpcAllocatorState());
    auto run = PredictionRun::Start(context, io, OnSteadyClock(DeadlineOf(rpc)), std::move(request),
                                    [this, &rpc](absl::Status status) {
                                      // The call lasts until its caller has taken the answer, which may be never.
                                      rpc.GetRpcAllocatorState()->FreeRequest();
                                      Finish(ToGrpcStatus(status));
                                    });
    const MutexLock lock(mutex_);
    run_ = std::move(run);
    if (cancelled_) run_->Cancel();
  }

  void OnCancel() override {
    const MutexLock lock(mutex_);
    cancelled_ = true;
    if (run_ != nullptr) run_->Cancel();
  }

  void OnDone() override { delete this; }

 private:
  Mutex mutex_;
  std::shared_ptr<PredictionRun> run_ ABSL_GUARDED_BY(mutex_);
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace

PredictionService::PredictionService(PredictionContext& context) : context_(context) {
  SetMessageAllocatorFor_PredictActionProbabilities(&probabilities_messages_);
  SetMessageAllocatorFor_PredictActionDistributions(&distributions_messages_);
  SetMessageAllocatorFor_Predict(&predict_messages_);
  SetMessageAllocatorFor_ClassifyTrajectories(&classify_messages_);
}

PredictionService::~PredictionService() = default;

grpc::ServerUnaryReactor* PredictionService::PredictActionProbabilities(
    grpc::CallbackServerContext* rpc, const v1::PredictActionProbabilitiesRequest* request,
    v1::PredictActionProbabilitiesResponse* response) {
  return new PredictionReactor(context_, *rpc,
                               {.model = &request->model(),
                                .scenarios = &request->scenarios(),
                                .priority = request->priority(),
                                .required_action_names = &request->required_action_names(),
                                .strict = request->strict(),
                                .bytes = Bytes(*request),
                                .model_version = response->mutable_model_version(),
                                .action_names = NamesIfWanted(*request, response),
                                .predictions = response->mutable_predictions()});
}

grpc::ServerUnaryReactor* PredictionService::PredictActionDistributions(
    grpc::CallbackServerContext* rpc, const v1::PredictActionDistributionsRequest* request,
    v1::PredictActionDistributionsResponse* response) {
  return new PredictionReactor(context_, *rpc,
                               {.model = &request->model(),
                                .scenarios = &request->scenarios(),
                                .query = &request->query(),
                                .probabilities = false,
                                .priority = request->priority(),
                                .required_action_names = &request->required_action_names(),
                                .strict = request->strict(),
                                .bytes = Bytes(*request),
                                .model_version = response->mutable_model_version(),
                                .waypoint_times = response->mutable_waypoint_times(),
                                .action_names = NamesIfWanted(*request, response),
                                .predictions = response->mutable_predictions()});
}

grpc::ServerUnaryReactor* PredictionService::Predict(grpc::CallbackServerContext* rpc,
                                                     const v1::PredictRequest* request,
                                                     v1::PredictResponse* response) {
  return new PredictionReactor(context_, *rpc, PredictIo(*request, response));
}

grpc::ServerUnaryReactor* PredictionService::ClassifyTrajectories(
    grpc::CallbackServerContext* rpc, const v1::ClassifyTrajectoriesRequest* request,
    v1::ClassifyTrajectoriesResponse* response) {
  return new PredictionReactor(context_, *rpc,
                               {.model = &request->model(),
                                .scenarios = &request->scenarios(),
                                .priority = request->priority(),
                                .required_action_names = &request->required_action_names(),
                                .strict = request->strict(),
                                .bytes = Bytes(*request),
                                .model_version = response->mutable_model_version(),
                                .action_names = NamesIfWanted(*request, response),
                                .classifications = response->mutable_classifications()});
}

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* PredictionService::StreamPredict(
    grpc::CallbackServerContext* rpc) {
  return PredictStream::Open(context_, streams_, rpc);
}

// A large map takes a while to check and to digest: not on gRPC's threads.
grpc::ServerUnaryReactor* PredictionService::RegisterMap(grpc::CallbackServerContext*,
                                                         const v1::RegisterMapRequest* request,
                                                         v1::RegisterMapResponse* response) {
  return AnswerFrom({context_.blocking, context_.send_memory}, request, response,
                    [this, request, response] {
                      auto registered = context_.maps.Register(request->map_features());
                      if (registered.ok()) {
                        response->set_map_id(std::move(registered->id));
                        response->set_size_bytes(registered->bytes);
                      }
                      return registered.status();
                    });
}

}  // namespace maneuver::rpc
