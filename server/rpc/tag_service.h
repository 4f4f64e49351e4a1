#ifndef MANEUVER_SERVER_RPC_TAG_SERVICE_H_
#define MANEUVER_SERVER_RPC_TAG_SERVICE_H_

#include "maneuver/v1/tag_service.grpc.pb.h"
#include "server/jobs/supervisor.h"
#include "server/rpc/blocking_call.h"
#include "server/security/access_control.h"

namespace maneuver::rpc {

// Lists, sends and deletes tags.
class TagService final : public v1::TagService::CallbackService {
 public:
  // All arguments must outlive the service. The .cc defines the constructor and the destructor, for
  // the reason that admin_service.h gives.
  TagService(jobs::Supervisor& jobs, const BlockingWork& blocking, security::AccessControl& access);
  ~TagService() override;

  grpc::ServerUnaryReactor* ListTags(grpc::CallbackServerContext* rpc,
                                     const v1::ListTagsRequest* request,
                                     v1::ListTagsResponse* response) override;
  grpc::ServerUnaryReactor* GetTags(grpc::CallbackServerContext* rpc,
                                    const v1::GetTagsRequest* request, v1::Tags* response) override;
  grpc::ServerWriteReactor<v1::DownloadTagsResponse>* DownloadTags(
      grpc::CallbackServerContext* rpc, const v1::DownloadTagsRequest* request) override;
  grpc::ServerUnaryReactor* DeleteTags(grpc::CallbackServerContext* rpc,
                                       const v1::DeleteTagsRequest* request,
                                       google::protobuf::Empty* response) override;

 private:
  jobs::Supervisor& jobs_;
  const BlockingWork blocking_;
  security::AccessControl& access_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_TAG_SERVICE_H_
