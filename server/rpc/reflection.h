// grpc.reflection.v1: describes the server's services to tools such as grpcurl. v1alpha, which older
// tools ask, has the same messages and gets the same answers.
//
// Strangers may call it. So it bounds what they can hold here: 64 calls at once, requests of 1 KiB,
// and what their connections bring meanwhile.

#ifndef MANEUVER_SERVER_RPC_REFLECTION_H_
#define MANEUVER_SERVER_RPC_REFLECTION_H_

#include <atomic>
#include <string>
#include <vector>

#include "grpc/reflection/v1/reflection.grpc.pb.h"
#include "server/rpc/small_messages.h"

namespace maneuver::rpc {

// Answers one request from the descriptors that are compiled into this program. An unknown name has
// an error_response with NOT_FOUND; a request that asks nothing has one with INVALID_ARGUMENT.
//   services: full names of all services of the server
grpc::reflection::v1::ServerReflectionResponse AnswerReflection(
    const grpc::reflection::v1::ServerReflectionRequest& request,
    const std::vector<std::string>& services);

// Its calls read bytes, so that a large request is refused before it is parsed.
class ReflectionService final
    : public grpc::reflection::v1::ServerReflection::WithRawCallbackMethod_ServerReflectionInfo<
          grpc::reflection::v1::ServerReflection::Service> {
 public:
  // Serves both versions. Adds their names.
  //   services: full names of the other services of the server
  //   small: bounds requests; must outlive the server
  ReflectionService(std::vector<std::string> services, SmallMessages& small);

  // Returns the paths of its methods.
  static std::vector<std::string> MethodNames();

  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* ServerReflectionInfo(
      grpc::CallbackServerContext* rpc) override;

 private:
  std::vector<std::string> services_;
  SmallMessages& small_;
  std::atomic<int> calls_ = 0;  // that are open
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_REFLECTION_H_
