#include "server/rpc/guarded_service.h"

#include <google/protobuf/descriptor.h>
#include <grpc/byte_buffer.h>
#include <grpc/grpc_security_constants.h>
#include <grpc/support/time.h>
#include <grpcpp/security/auth_context.h>
#include <grpcpp/support/byte_buffer.h>

#include <algorithm>
#include <cstdint>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"
#include "server/rpc/grpc_internals.h"
#include "server/rpc/request_outline.h"
#include "server/rpc/status_details.h"

namespace maneuver::rpc {
namespace {

using google::protobuf::MethodDescriptor;
using grpc::ByteBuffer;

// Ends a call at once. Deletes itself.
template <typename Reactor>
class Refusal final : public InlineReactor<Reactor> {
 public:
  explicit Refusal(const grpc::Status& status) { this->Finish(status); }
  void OnDone() override { delete this; }
};

RpcMethod::RpcType TypeOf(const MethodDescriptor& method) {
  if (method.client_streaming()) {
    return method.server_streaming() ? RpcMethod::BIDI_STREAMING : RpcMethod::CLIENT_STREAMING;
  }
  return method.server_streaming() ? RpcMethod::SERVER_STREAMING : RpcMethod::NORMAL_RPC;
}

// A handler of gRPC's own that answers any call of this type with `status`.
std::unique_ptr<MethodHandler> RefusingHandler(RpcMethod::RpcType type,
                                               const grpc::Status& status) {
  using Context = grpc::CallbackServerContext;
  switch (type) {
    case RpcMethod::NORMAL_RPC:
      return std::make_unique<UnaryHandler<ByteBuffer, ByteBuffer>>(
          [status](Context*, const ByteBuffer*, ByteBuffer*) {
            return new Refusal<grpc::ServerUnaryReactor>(status);
          });
    case RpcMethod::CLIENT_STREAMING:
      return std::make_unique<ClientStreamingHandler<ByteBuffer, ByteBuffer>>(
          [status](Context*, ByteBuffer*) {
            return new Refusal<grpc::ServerReadReactor<ByteBuffer>>(status);
          });
    case RpcMethod::SERVER_STREAMING:
      return std::make_unique<ServerStreamingHandler<ByteBuffer, ByteBuffer>>(
          [status](Context*, const ByteBuffer*) {
            return new Refusal<grpc::ServerWriteReactor<ByteBuffer>>(status);
          });
    case RpcMethod::BIDI_STREAMING:
      break;
  }
  return std::make_unique<BidiHandler<ByteBuffer, ByteBuffer>>([status](Context*) {
    return new Refusal<grpc::ServerBidiReactor<ByteBuffer, ByteBuffer>>(status);
  });
}

// The same bytes. Empty if there are none, or if they are not as they were sent.
ByteBuffer Shared(grpc_byte_buffer* bytes) {
  if (bytes == nullptr || bytes->type != GRPC_BB_RAW ||
      bytes->data.raw.compression != GRPC_COMPRESS_NONE) {
    return {};
  }
  const grpc_slice_buffer& parts = bytes->data.raw.slice_buffer;
  std::vector<grpc::Slice> slices;
  for (size_t i = 0; i < parts.count; ++i) {
    slices.emplace_back(parts.slices[i], grpc::Slice::ADD_REF);
  }
  return {slices.data(), slices.size()};
}

// Whether a method, named /SERVICE/METHOD, stops or removes something.
bool MakesRoom(std::string_view method) {
  const std::string_view name = method.substr(method.rfind('/') + 1);
  return name.starts_with("Cancel") || name.starts_with("Delete");
}

// Methods that answer with a stream are asked by a name, and gRPC keeps the request until the end.
absl::Status CheckSize(int64_t bytes) {
  constexpr int64_t kMost = int64_t{64} << 10;
  if (bytes <= kMost) return absl::OkStatus();
  return errors::InvalidField("name", "comes in a request of more than 64 KiB; send less");
}

class GuardedHandler final : public MethodHandler {
 public:
  GuardedHandler(MethodHandler& guarded, std::string_view method, RpcMethod::RpcType type,
                 const google::protobuf::Descriptor& request, security::AccessControl& access,
                 const NamedService& service)
      : guarded_(guarded),
        request_(request),
        method_(method),
        type_(type),
        access_(access),
        worth_(service.worth),
        refusal_(service.refusal),
        room_(MakesRoom(method) ? nullptr : service.room) {}

  // gRPC calls this first, with the request of a method that takes a single one; it is kept as it
  // is, to be parsed only once its caller is admitted.
  void* Deserialize(grpc_call*, grpc_byte_buffer* request, grpc::Status*, void**) override {
    return request;
  }

  void RunHandler(const HandlerParameter& call) override {
    absl::Status status = access_.Admit(method_, CredentialsOf(*call.server_context));
    if (status.ok()) status = refusal_;
    const int64_t bytes = RequestBytes(call);
    std::shared_ptr<const void> kept;  // until the request is parsed
    if (status.ok() && room_) {
      auto room = room_(bytes);
      status = room.status();
      if (room.ok()) kept = *std::move(room);
    }
    if (status.ok() && type_ == RpcMethod::SERVER_STREAMING) status = CheckSize(bytes);
    if (status.ok() && bytes >= kLeastCheckedDensity) {
      status = CheckDensity(request_, Shared(static_cast<grpc_byte_buffer*>(call.request)));
    }
    if (status.ok() && worth_ && type_ == RpcMethod::NORMAL_RPC) {
      status = worth_(method_, DeadlineOf(*call.server_context),
                      Shared(static_cast<grpc_byte_buffer*>(call.request)));
    }
    if (status.ok()) {
      Run(guarded_, call);
    } else {
      // Needed no longer than this: a call holds nothing of its handler.
      Run(*RefusingHandler(type_, ToGrpcStatus(status)), call);
    }
  }

 private:
  // Returns the size of the single request; 0 if the call streams its requests, or has none.
  int64_t RequestBytes(const HandlerParameter& call) const {
    if (type_ != RpcMethod::NORMAL_RPC && type_ != RpcMethod::SERVER_STREAMING) return 0;
    auto* request = static_cast<grpc_byte_buffer*>(call.request);
    return request == nullptr ? 0 : static_cast<int64_t>(grpc_byte_buffer_length(request));
  }

  void Run(MethodHandler& handler, const HandlerParameter& call) {
    grpc::Status status = call.status;
    void* data = nullptr;
    void* request = nullptr;
    if (type_ == RpcMethod::NORMAL_RPC || type_ == RpcMethod::SERVER_STREAMING) {
      // Takes the buffer over. There is none if the caller sent no message: the parser then says
      // so.
      request = handler.Deserialize(call.call->call(), static_cast<grpc_byte_buffer*>(call.request),
                                    &status, &data);
    }
    handler.RunHandler(HandlerParameter(call.call, call.server_context, request, status, data,
                                        call.call_requester));
  }

  MethodHandler& guarded_;
  const google::protobuf::Descriptor& request_;
  const std::string_view method_;
  const RpcMethod::RpcType type_;
  security::AccessControl& access_;
  const decltype(NamedService::worth) worth_;
  const absl::Status refusal_;
  const decltype(NamedService::room) room_;
};

// A service's handlers, which it shows to those who derive from it.
struct HandlersOf : grpc::Service {
  using grpc::Service::GetHandler;
};

std::string ToString(grpc::string_ref text) { return {text.data(), text.size()}; }

// "ipv4:10.1.2.3:4567" without the port, which is another with each connection.
std::string WithoutPort(const std::string& peer) { return peer.substr(0, peer.rfind(':')); }

}  // namespace

absl::StatusOr<std::unique_ptr<GuardedService>> GuardedService::Create(
    const NamedService& guarded, security::AccessControl& access) {
  const auto* service =
      google::protobuf::DescriptorPool::generated_pool()->FindServiceByName(guarded.name);
  if (service == nullptr) {
    return absl::InternalError(absl::StrCat("the contract has no service ", guarded.name));
  }
  std::unique_ptr<GuardedService> guard(new GuardedService);
  // The generated code adds methods in the order of the contract.
  for (int i = 0; i < service->method_count(); ++i) {
    const MethodDescriptor& method = *service->method(i);
    const std::string& name =
        *guard->method_names_.emplace_back(std::make_unique<const std::string>(
            absl::StrCat("/", service->full_name(), "/", method.name())));
    MethodHandler* const handler = (guarded.service->*&HandlersOf::GetHandler)(i);
    if (handler == nullptr) {
      return absl::InternalError(absl::StrCat(name, " is not served by gRPC's callback API"));
    }
    const RpcMethod::RpcType type = TypeOf(method);
    guard->AddMethod(new RpcServiceMethod(name.c_str(), type, nullptr));
    guard->MarkMethodCallback(
        i, new GuardedHandler(*handler, name, type, *method.input_type(), access, guarded));
  }
  return guard;
}

std::vector<std::string> GuardedService::MethodNames() const {
  std::vector<std::string> names;
  for (const auto& name : method_names_) names.push_back(*name);
  return names;
}

std::chrono::system_clock::time_point DeadlineOf(const grpc::ServerContextBase& rpc) {
  constexpr int64_t kNever = int64_t{100} * 24 * 3600;  // seconds
  const gpr_timespec deadline = rpc.raw_deadline();
  const gpr_timespec left = gpr_time_sub(deadline, gpr_now(deadline.clock_type));
  if (left.tv_sec >= kNever) return std::chrono::system_clock::time_point::max();
  // Long past is past.
  const int64_t seconds = std::max<int64_t>(left.tv_sec, -kNever);
  return std::chrono::system_clock::now() + std::chrono::seconds(seconds) +
         std::chrono::nanoseconds(left.tv_nsec);
}

security::Credentials CredentialsOf(const grpc::ServerContextBase& rpc) {
  security::Credentials credentials;
  const auto [begin, end] = rpc.client_metadata().equal_range("authorization");
  for (auto header = begin; header != end; ++header) {
    credentials.authorization.push_back(ToString(header->second));
  }
  const auto connection = rpc.auth_context();
  if (connection != nullptr) {
    // Not GRPC_X509_SAN_PROPERTY_NAME: it has e-mail names as well, which anyone may be given.
    for (const char* const kind :
         {GRPC_PEER_DNS_PROPERTY_NAME, GRPC_PEER_URI_PROPERTY_NAME, GRPC_PEER_IP_PROPERTY_NAME}) {
      for (const auto& name : connection->FindPropertyValues(kind)) {
        credentials.alternative_names.push_back(ToString(name));
      }
    }
    const auto common = connection->FindPropertyValues(GRPC_X509_CN_PROPERTY_NAME);
    if (!common.empty()) credentials.common_name = ToString(common.front());
  }
  credentials.peer = WithoutPort(rpc.peer());
  return credentials;
}

}  // namespace maneuver::rpc
