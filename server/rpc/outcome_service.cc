#include "server/rpc/outcome_service.h"

#include <cstdint>

#include "server/rpc/guarded_service.h"
#include "server/rpc/outcome_stream.h"
#include "server/rpc/status_details.h"

namespace maneuver::rpc {

OutcomeService::OutcomeService(PredictionContext& context, serving::OutcomeMetrics& metrics,
                               WorkerPool& scoring, const OutcomeStorage& storage)
    : blocking_{context.blocking, context.send_memory},
      storage_(storage),
      scorer_(context, metrics, scoring, storage) {}

OutcomeService::~OutcomeService() = default;

grpc::ServerUnaryReactor* OutcomeService::ReportOutcomes(grpc::CallbackServerContext* rpc,
                                                         const v1::ReportOutcomesRequest* request,
                                                         v1::ReportOutcomesResponse* response) {
  auto* call = new CountedCall(blocking_.send_memory);
  if (const absl::Status admitted = scorer_.Admit(CredentialsOf(*rpc), *request); !admitted.ok()) {
    FreeMessage(request);
    call->Finish(ToGrpcStatus(admitted));
    return call;
  }
  const auto memory = scorer_.Reserve(WaitingBytes(*request));
  const bool accepted =
      memory != nullptr && scorer_.pool().Post([this, call, rpc, request, response, memory] {
        call->Answer(request, response, [&] { return scorer_.Score(*rpc, *request, response); });
      });
  if (!accepted) {
    FreeMessage(request);
    call->Finish(ToGrpcStatus(TooManyWait()));
  }
  return call;
}

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* OutcomeService::StreamOutcomes(
    grpc::CallbackServerContext* rpc) {
  return OutcomeStream::Open(scorer_, streams_, rpc);
}

grpc::ServerUnaryReactor* OutcomeService::CollectOutcomes(grpc::CallbackServerContext*,
                                                          const v1::CollectOutcomesRequest* request,
                                                          v1::CollectOutcomesResponse* response) {
  return AnswerFrom(blocking_, request, response, [this, request, response] {
    return MakeOutcomeDataset(storage_, *request, response);
  });
}

}  // namespace maneuver::rpc
