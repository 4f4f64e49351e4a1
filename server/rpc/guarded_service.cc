#include "server/rpc/guarded_service.h"

#include <google/protobuf/descriptor.h>
#include <grpc/byte_buffer.h>
#include <grpc/grpc_security_constants.h>
#include <grpc/support/time.h>
#include <grpcpp/security/auth_context.h>
#include <grpcpp/support/byte_buffer.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"
#include "server/rpc/grpc_internals.h"
#include "server/rpc/message_gate.h"
#include "server/rpc/request_outline.h"
#include "server/rpc/small_messages.h"
#include "server/rpc/status_details.h"
#include "server/security/identities.h"

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

bool TakesOneRequest(RpcMethod::RpcType type) {
  return type == RpcMethod::NORMAL_RPC || type == RpcMethod::SERVER_STREAMING;
}

// A handler of gRPC's own that answers any call of this type with `status`, without its request.
std::unique_ptr<MethodHandler> RefusingHandler(RpcMethod::RpcType type,
                                               const grpc::Status& status) {
  using Context = grpc::CallbackServerContext;
  if (type == RpcMethod::CLIENT_STREAMING) {
    return std::make_unique<ClientStreamingHandler<ByteBuffer, ByteBuffer>>(
        [status](Context*, ByteBuffer*) {
          return new Refusal<grpc::ServerReadReactor<ByteBuffer>>(status);
        });
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

// gRPC keeps the request of a method that answers with a stream until the end. The largest that makes
// sense continues a download of many files.
absl::Status CheckSize(int64_t bytes) {
  constexpr int64_t kMost = int64_t{1} << 20;
  if (bytes <= kMost) return absl::OkStatus();
  return errors::WithReason(
      absl::ResourceExhaustedError("a request for a stream of answers has at most 1 MiB"),
      "REQUEST_TOO_LARGE");
}

// The handler of one method, and what stands before it. It must outlive the server.
class GuardedHandler final : public MethodHandler {
 public:
  GuardedHandler(MethodHandler& guarded, std::string_view method, RpcMethod::RpcType type,
                 const google::protobuf::Descriptor& request, security::AccessControl& access,
                 const NamedService& service, MessageGate& gate)
      : guarded_(guarded),
        request_(request),
        method_(method),
        type_(type),
        access_(access),
        check_request_(service.check_request),
        refusal_(service.refusal),
        reserve_memory_(MakesRoom(method) ? nullptr : service.reserve_memory),
        gate_(MakesRoom(method) || service.message_gate == nullptr ? gate : *service.message_gate),
        small_messages_(service.small_messages) {}

  void RunHandler(const HandlerParameter& call) override {
    absl::Status status = access_.Admit(method_, CredentialsOf(*call.server_context));
    if (status.ok()) status = refusal_;
    if (status.ok() && reserve_memory_) status = reserve_memory_(0).status();
    if (!status.ok()) {
      Refuse(call, status);
    } else if (!TakesOneRequest(type_)) {
      Run(call, nullptr);
    } else {
      gate_.Enter(std::make_shared<ReceivedRequest>(*this, call), call.server_context->peer(),
                  std::chrono::steady_clock::now());
    }
  }

 private:
  // A call whose single request gRPC receives. It is received only once its caller is admitted, and
  // is not parsed here.
  class ReceivedRequest final : public UnreceivedCall,
                                public std::enable_shared_from_this<ReceivedRequest> {
   public:
    ReceivedRequest(GuardedHandler& handler, const HandlerParameter& call)
        : handler_(handler), call_(call) {}

    void Receive() override {
      if (SmallMessages* const small = handler_.small_messages_) {
        number_ = small->Add(call_.server_context->peer(),
                             [self = shared_from_this()] { self->reading_.Cancel(NotSmall()); });
      }
      reading_.Start(*call_.call, [self = shared_from_this()](grpc_byte_buffer* request) {
        self->OnReceived(request);
      });
    }
    void Refuse(const absl::Status& status) override { handler_.Refuse(call_, status); }
    void Stop(const absl::Status& status) override {
      handler_.Refuse(HandlerParameter(call_.call, call_.server_context, nullptr, grpc::Status::OK,
                                       nullptr, [self = shared_from_this()] { self->EndHalf(); }),
                      status);
    }
    void Cancel() override { reading_.Cancel(absl::ResourceExhaustedError("stopped")); }

   private:
    // No request: the caller sent none, or has gone. The parser then says so.
    void OnReceived(grpc_byte_buffer* request) {
      SmallMessages* const small = handler_.small_messages_;
      const bool is_stopped = !handler_.gate_.Leave(*this);
      const bool is_small = small == nullptr || small->Remove(number_);
      if (!is_stopped && is_small) {
        handler_.OnReceived(call_, request);
        return;
      }
      if (request != nullptr) grpc_byte_buffer_destroy(request);
      if (is_stopped) {
        EndHalf();
      } else {
        Refuse(NotSmall());
      }
    }

    // Of a stopped call, two things end in any order: its refusal, and the reading of its request,
    // which needs the call's context.
    void EndHalf() {
      if (half_ended_.exchange(true)) call_.call_requester();
    }

    GuardedHandler& handler_;
    const HandlerParameter call_;
    int64_t number_ = 0;  // among small messages
    std::atomic<bool> half_ended_ = false;
    MessageReading reading_{call_.call->call()};
  };

  // Takes `request` over.
  void OnReceived(const HandlerParameter& call, grpc_byte_buffer* request) {
    const auto bytes =
        request == nullptr ? 0 : static_cast<int64_t>(grpc_byte_buffer_length(request));
    absl::Status status;
    std::shared_ptr<const void> kept;  // until the request is parsed
    if (reserve_memory_) {
      auto reserved = reserve_memory_(bytes);
      status = reserved.status();
      if (reserved.ok()) kept = *std::move(reserved);
    }
    if (status.ok() && small_messages_ != nullptr && bytes > SmallMessages::kMostBytes) {
      status = NotSmall();
    }
    if (status.ok() && type_ == RpcMethod::SERVER_STREAMING) status = CheckSize(bytes);
    if (status.ok() && bytes >= kLeastCheckedDensity) {
      status = CheckDensity(request_, Shared(request));
    }
    if (status.ok() && check_request_ && type_ == RpcMethod::NORMAL_RPC) {
      status = check_request_(method_, DeadlineOf(*call.server_context), Shared(request));
    }
    if (status.ok()) {
      Run(call, request);
      return;
    }
    if (request != nullptr) grpc_byte_buffer_destroy(request);
    Refuse(call, status);
  }

  // Takes `request` over; it is null for a call that streams its requests.
  void Run(const HandlerParameter& call, grpc_byte_buffer* request) {
    grpc::Status status = call.status;
    void* data = nullptr;
    void* parsed = nullptr;
    if (TakesOneRequest(type_)) {
      parsed = guarded_.Deserialize(call.call->call(), request, &status, &data);
    }
    guarded_.RunHandler(HandlerParameter(call.call, call.server_context, parsed, status, data,
                                         call.call_requester));
  }

  void Refuse(const HandlerParameter& call, const absl::Status& status) {
    // Needed no longer than this: a call holds nothing of its handler.
    RefusingHandler(type_, ToGrpcStatus(status))
        ->RunHandler(HandlerParameter(call.call, call.server_context, nullptr, grpc::Status::OK,
                                      nullptr, call.call_requester));
  }

  MethodHandler& guarded_;
  const google::protobuf::Descriptor& request_;
  const std::string_view method_;
  const RpcMethod::RpcType type_;
  security::AccessControl& access_;
  const decltype(NamedService::check_request) check_request_;
  const absl::Status refusal_;
  const decltype(NamedService::reserve_memory) reserve_memory_;
  MessageGate& gate_;
  SmallMessages* const small_messages_;
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
    const NamedService& guarded, security::AccessControl& access, MessageGate& gate) {
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
    // To gRPC, a method that takes a single request is one that streams both ways: otherwise gRPC
    // would receive the request before this server knows of the call.
    const auto received_by = TakesOneRequest(type) ? RpcMethod::BIDI_STREAMING : type;
    guard->AddMethod(new RpcServiceMethod(name.c_str(), received_by, nullptr));
    guard->MarkMethodCallback(
        i, new GuardedHandler(*handler, name, type, *method.input_type(), access, guarded, gate));
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
    using security::NameKind;
    // Not GRPC_X509_SAN_PROPERTY_NAME: it has e-mail names as well, which anyone may be given.
    constexpr std::pair<const char*, NameKind> kKinds[] = {
        {GRPC_PEER_DNS_PROPERTY_NAME, NameKind::kDns},
        {GRPC_PEER_URI_PROPERTY_NAME, NameKind::kUri},
        {GRPC_PEER_IP_PROPERTY_NAME, NameKind::kAddress}};
    for (const auto& [property, kind] : kKinds) {
      for (const auto& value : connection->FindPropertyValues(property)) {
        std::string name = ToString(value);
        if (security::KindOf(name) == kind) {
          credentials.alternative_names.push_back(std::move(name));
        }
      }
    }
    const auto common = connection->FindPropertyValues(GRPC_X509_CN_PROPERTY_NAME);
    if (!common.empty()) credentials.common_name = ToString(common.front());
  }
  credentials.peer = WithoutPort(rpc.peer());
  return credentials;
}

}  // namespace maneuver::rpc
