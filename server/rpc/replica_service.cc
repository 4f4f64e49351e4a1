#include "server/rpc/replica_service.h"

#include "server/rpc/blocking_call.h"

namespace maneuver::rpc {

ReplicaService::ReplicaService(jobs::ReplicaRegistry* replicas, WorkerPool& pool)
    : replicas_(replicas), pool_(pool) {}

ReplicaService::~ReplicaService() = default;

grpc::ServerUnaryReactor* ReplicaService::ListReplicas(grpc::CallbackServerContext* rpc,
                                                       const v1::ListReplicasRequest* request,
                                                       v1::ListReplicasResponse* response) {
  return AnswerFrom(pool_, rpc, request, [this, response]() -> absl::Status {
    if (replicas_ == nullptr) return absl::OkStatus();
    auto live = replicas_->ListLive();
    if (!live.ok()) return live.status();
    response->mutable_replicas()->Assign(live->begin(), live->end());
    return absl::OkStatus();
  });
}

}  // namespace maneuver::rpc
