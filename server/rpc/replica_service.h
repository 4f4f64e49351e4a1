#ifndef MANEUVER_SERVER_RPC_REPLICA_SERVICE_H_
#define MANEUVER_SERVER_RPC_REPLICA_SERVICE_H_

#include "maneuver/v1/replica_service.grpc.pb.h"
#include "server/jobs/replica_registry.h"
#include "server/rpc/blocking_call.h"

namespace maneuver::rpc {

// Lists the servers that share a store.
class ReplicaService final : public v1::ReplicaService::CallbackService {
 public:
  // All arguments must outlive the service. The .cc defines the constructor and the destructor, for
  // the reason that admin_service.h gives.
  //   replicas: nullptr if this server shares no store; then the list is empty
  ReplicaService(jobs::ReplicaRegistry* replicas, const BlockingWork& blocking);
  ~ReplicaService() override;

  grpc::ServerUnaryReactor* ListReplicas(grpc::CallbackServerContext* rpc,
                                         const v1::ListReplicasRequest* request,
                                         v1::ListReplicasResponse* response) override;

 private:
  jobs::ReplicaRegistry* const replicas_;
  const BlockingWork blocking_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_REPLICA_SERVICE_H_
