#include "server/rpc/call_observer.h"

#include <grpc/byte_buffer.h>
#include <grpcpp/server_context.h>

#include <atomic>
#include <chrono>
#include <random>
#include <string_view>
#include <utility>

#include "server/rpc/call_log.h"
#include "server/rpc/call_metrics.h"
#include "server/rpc/status_details.h"

namespace maneuver::rpc {
namespace {

using Clock = std::chrono::steady_clock;
using grpc::experimental::InterceptionHookPoints;
using grpc::experimental::InterceptorBatchMethods;
using grpc::experimental::ServerRpcInfo;

// Lives as long as its call. Reads and writes of a stream come from several threads.
class CallInterceptor final : public grpc::experimental::Interceptor {
 public:
  CallInterceptor(MethodMetrics& metrics, CallLog& log, OpenCalls& open, ServerRpcInfo& call)
      : metrics_(metrics),
        log_(log),
        open_(open),
        call_(call),
        is_method_(metrics.name() != kUnknownMethod),
        start_(Clock::now()) {
    metrics_.Begin();
  }
  // A call that broke off before it was given a status was cancelled.
  ~CallInterceptor() override {
    End(grpc::StatusCode::CANCELLED);
    Close();
  }

  void Intercept(InterceptorBatchMethods* batch) override {
    if (batch->QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_INITIAL_METADATA)) {
      Introduce(*batch->GetRecvInitialMetadata());
      peer_ = call_.server_context()->peer();
      begun_ = open_.Begin(peer_);
    }
    if (batch->QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_CLOSE)) Close();
    if (metrics_.of_contract()) CountBytes(*batch);
    if (batch->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_STATUS)) {
      grpc::StatusCode counted = batch->GetSendStatus().error_code();
      if (IsOfGrpc(batch->GetSendStatus()) && !is_method_) {
        batch->ModifySendStatus(
            {grpc::StatusCode::UNIMPLEMENTED, "this server has no such method"});
      } else if (IsOfGrpc(batch->GetSendStatus())) {
        batch->ModifySendStatus(ToGrpcStatus(errors::MalformedMessage()));
        // Without a request the caller has gone, or gRPC itself has refused the request.
        counted = lacks_request_ ? grpc::StatusCode::CANCELLED : grpc::StatusCode::INVALID_ARGUMENT;
      }
      batch->GetSendTrailingMetadata()->emplace("x-request-id", origin_.request_id);
      End(counted);
    }
    batch->Proceed();
  }

 private:
  void Introduce(const std::multimap<grpc::string_ref, grpc::string_ref>& headers) {
    const auto value = [&headers](const char* name) {
      const auto header = headers.find(name);
      return header == headers.end()
                 ? std::string_view()
                 : std::string_view(header->second.data(), header->second.size());
    };
    origin_ = log_.OriginOf(value("x-request-id"), value("traceparent"));
  }

  // So gRPC itself ends a call that it cannot parse, or whose method is unknown, and nobody else does.
  static bool IsOfGrpc(const grpc::Status& status) {
    return status.error_code() == grpc::StatusCode::UNIMPLEMENTED && status.error_message().empty();
  }

  void CountBytes(InterceptorBatchMethods& batch) {
    if (batch.QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_MESSAGE)) {
      const size_t bytes = SizeOf(batch.GetRecvMessage());
      // How long a caller takes to send its first message is not the server's time.
      if (received_ == 0) start_ = Clock::now();
      lacks_request_ = batch.GetRecvMessage() == nullptr && received_ == 0;
      received_ += static_cast<int64_t>(bytes);
      metrics_.Received(bytes);
    }
    if (batch.QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_MESSAGE)) {
      // Serialised here in place of a little later.
      const size_t bytes = batch.GetSerializedSendMessage()->Length();
      sent_ += static_cast<int64_t>(bytes);
      metrics_.Sent(bytes);
    }
  }

  // Of a message as this server receives each: the bytes themselves (see MessageReading, UploadCall
  // and PredictStream).
  static size_t SizeOf(void* message) {
    if (message == nullptr) return 0;  // the end of the stream
    return static_cast<grpc::ByteBuffer*>(message)->Length();
  }

  void End(grpc::StatusCode code) {
    if (ended_.exchange(true)) return;
    const auto time = Clock::now() - start_.load();
    metrics_.End(code, time);
    log_.Write({.method = metrics_.name(),
                .code = code,
                .time = time,
                .request_bytes = received_,
                .response_bytes = sent_},
               origin_);
  }

  // The call counts as open until here.
  void Close() {
    if (!peer_.empty()) open_.End(std::exchange(peer_, ""), begun_);
  }

  MethodMetrics& metrics_;
  CallLog& log_;
  OpenCalls& open_;
  ServerRpcInfo& call_;
  const bool is_method_;  // of this server
  std::atomic<Clock::time_point> start_;
  std::string peer_;  // while the call counts as open
  int64_t begun_ = 0;
  CallOrigin origin_;  // set before anything else of the call happens
  std::atomic<int64_t> received_ = 0;
  std::atomic<int64_t> sent_ = 0;
  std::atomic<bool> lacks_request_ = false;
  std::atomic<bool> ended_ = false;
};

class CallObserver final : public grpc::experimental::ServerInterceptorFactoryInterface {
 public:
  CallObserver(monitoring::MetricRegistry& metrics, const std::vector<std::string>& methods,
               const std::vector<std::string>& others, OpenCalls& open)
      : metrics_(metrics, methods, others), log_(std::random_device()()), open_(open) {}

  grpc::experimental::Interceptor* CreateServerInterceptor(ServerRpcInfo* info) override {
    return new CallInterceptor(metrics_.Find(info->method()), log_, open_, *info);
  }

 private:
  CallMetrics metrics_;
  CallLog log_;
  OpenCalls& open_;
};

}  // namespace

std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> ObserveCalls(
    monitoring::MetricRegistry& metrics, const std::vector<std::string>& methods,
    const std::vector<std::string>& others, OpenCalls& open) {
  return std::make_unique<CallObserver>(metrics, methods, others, open);
}

}  // namespace maneuver::rpc
