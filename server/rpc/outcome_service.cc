#include "server/rpc/outcome_service.h"

#include <cstdint>

#include "server/rpc/blocking_call.h"
#include "server/rpc/guarded_service.h"
#include "server/rpc/outcome_stream.h"
#include "server/rpc/status_details.h"

namespace maneuver::rpc {

OutcomeService::OutcomeService(PredictionContext& context, serving::OutcomeMetrics& metrics,
                               WorkerPool& scoring, const OutcomeStorage& storage)
    : blocking_(context.blocking), storage_(storage), scorer_(context, metrics, scoring, storage) {}

OutcomeService::~OutcomeService() = default;

grpc::ServerUnaryReactor* OutcomeService::ReportOutcomes(grpc::CallbackServerContext* rpc,
                                                         const v1::ReportOutcomesRequest* request,
                                                         v1::ReportOutcomesResponse* response) {
  grpc::ServerUnaryReactor* reactor = rpc->DefaultReactor();
  if (const absl::Status admitted = scorer_.Admit(CredentialsOf(*rpc), *request); !admitted.ok()) {
    reactor->Finish(ToGrpcStatus(admitted));
    return reactor;
  }
  const auto memory = scorer_.Reserve(static_cast<int64_t>(request->ByteSizeLong()));
  const bool accepted =
      memory != nullptr && scorer_.pool().Post([this, reactor, rpc, request, response, memory] {
        const absl::Status status = scorer_.Score(*rpc, *request, response);
        FreeRequest(request);
        reactor->Finish(ToGrpcStatus(status));
      });
  if (!accepted) reactor->Finish(ToGrpcStatus(TooManyWait()));
  return reactor;
}

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* OutcomeService::StreamOutcomes(
    grpc::CallbackServerContext* rpc) {
  return OutcomeStream::Open(scorer_, streams_, rpc);
}

grpc::ServerUnaryReactor* OutcomeService::CollectOutcomes(grpc::CallbackServerContext* rpc,
                                                          const v1::CollectOutcomesRequest* request,
                                                          v1::CollectOutcomesResponse* response) {
  return AnswerFrom(blocking_, rpc, request, [this, request, response] {
    return MakeOutcomeDataset(storage_, *request, response);
  });
}

}  // namespace maneuver::rpc
