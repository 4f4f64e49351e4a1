#include "server/rpc/replica_service.h"

namespace maneuver::rpc {

ReplicaService::ReplicaService(jobs::ReplicaRegistry* replicas, const BlockingWork& blocking)
    : replicas_(replicas), blocking_(blocking) {}

ReplicaService::~ReplicaService() = default;

grpc::ServerUnaryReactor* ReplicaService::ListReplicas(grpc::CallbackServerContext*,
                                                       const v1::ListReplicasRequest* request,
                                                       v1::ListReplicasResponse* response) {
  return AnswerFrom(blocking_, request, response, [this, response]() -> absl::Status {
    if (replicas_ == nullptr) return absl::OkStatus();
    auto live = replicas_->ListLive();
    if (!live.ok()) return live.status();
    response->mutable_replicas()->Assign(live->begin(), live->end());
    return absl::OkStatus();
  });
}

}  // namespace maneuver::rpc
