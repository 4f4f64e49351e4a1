#ifndef MANEUVER_TESTS_INTEGRATION_RAW_CALL_H_
#define MANEUVER_TESTS_INTEGRATION_RAW_CALL_H_

#include <grpcpp/grpcpp.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

namespace maneuver::integration {

using Headers = std::multimap<std::string, std::string>;

struct RawAnswer {
  grpc::Status status;
  std::vector<std::string> messages;  // bytes
};

struct RawCall {
  std::string method;   // "/package.Service/Method"
  std::string request;  // bytes of the one message that is sent
  Headers headers = {};
  bool stop_after_first = false;  // cancel after the first message: for streams without an end
};

// Calls any method of any kind, by its name.
RawAnswer Call(const std::shared_ptr<grpc::Channel>& channel, const RawCall& call);

// Returns the methods that the server's reflection lists: "/package.Service/Method" for each method
// of each service.
//   version: of the reflection service, "v1" or "v1alpha"
std::vector<std::string> MethodsByReflection(const std::shared_ptr<grpc::Channel>& channel,
                                             const std::string& version);

// Returns the ErrorInfo.reason of a failed call; empty if there is none.
std::string Reason(const grpc::Status& status);

}  // namespace maneuver::integration

#endif  // MANEUVER_TESTS_INTEGRATION_RAW_CALL_H_
