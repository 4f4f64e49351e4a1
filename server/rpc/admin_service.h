#ifndef MANEUVER_SERVER_RPC_ADMIN_SERVICE_H_
#define MANEUVER_SERVER_RPC_ADMIN_SERVICE_H_

#include "maneuver/v1/admin_service.grpc.pb.h"

namespace maneuver::rpc {

// Reads and sets the level of the log.
class AdminService final : public v1::AdminService::CallbackService {
 public:
  // The constructor and the destructor are defined in the .cc. Otherwise every file that makes a
  // service would compile all of gRPC's call handling again.
  AdminService();
  ~AdminService() override;

  grpc::ServerUnaryReactor* GetLogLevel(grpc::CallbackServerContext* rpc,
                                        const v1::GetLogLevelRequest* request,
                                        v1::GetLogLevelResponse* response) override;
  grpc::ServerUnaryReactor* SetLogLevel(grpc::CallbackServerContext* rpc,
                                        const v1::SetLogLevelRequest* request,
                                        v1::SetLogLevelResponse* response) override;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_ADMIN_SERVICE_H_
