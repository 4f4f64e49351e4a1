#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/time/clock.h"
#include "client/client.h"
#include "client/connection.h"
#include "locks/mutex.h"

namespace maneuver::client {
namespace {

class GrpcPredictStream final : public PredictStream {
 public:
  GrpcPredictStream(v1::PredictionService::Stub& stub, OnResponse on_response,
                    const CallOptions& call, const std::string& authorization)
      : on_response_(std::move(on_response)),
        registration_(call.cancellation, [this] { context_.TryCancel(); }) {
    if (!authorization.empty()) context_.AddMetadata("authorization", authorization);
    if (call.timeout) context_.set_deadline(absl::ToChronoTime(absl::Now() + *call.timeout));
    stream_ = stub.StreamPredict(&context_);
    reader_ = std::thread([this] {
      v1::StreamPredictResponse response;
      while (stream_->Read(&response)) {
        if (on_response_) on_response_(response);
      }
    });
  }

  ~GrpcPredictStream() override {
    context_.TryCancel();
    Finish().IgnoreError();
  }

  absl::Status Send(const std::string& request_id, const v1::PredictRequest& request,
                    std::optional<absl::Duration> timeout) override {
    v1::StreamPredictRequest message;
    message.set_request_id(request_id);
    *message.mutable_request() = request;
    if (timeout) {
      absl::Duration rest = *timeout;
      message.mutable_timeout()->set_seconds(absl::IDivDuration(rest, absl::Seconds(1), &rest));
      message.mutable_timeout()->set_nanos(static_cast<int32_t>(absl::ToInt64Nanoseconds(rest)));
    }
    const MutexLock lock(write_mutex_);
    if (writes_done_) {
      return absl::FailedPreconditionError("the stream is finished; open another");
    }
    if (stream_->Write(message)) return absl::OkStatus();
    return absl::UnavailableError("the stream has broken; Finish() says why");
  }

  absl::Status Finish() override {
    {
      const MutexLock lock(write_mutex_);
      if (!writes_done_) {
        writes_done_ = true;
        stream_->WritesDone();
      }
    }
    const MutexLock lock(finish_mutex_);
    if (!end_) {
      reader_.join();
      end_ = ToStatus(stream_->Finish());
    }
    return *end_;
  }

  void Cancel() override { context_.TryCancel(); }

 private:
  const OnResponse on_response_;
  grpc::ClientContext context_;
  const Cancellation::Registration registration_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::StreamPredictRequest, v1::StreamPredictResponse>>
      stream_;
  std::thread reader_;
  Mutex write_mutex_;  // one Write at a time
  bool writes_done_ ABSL_GUARDED_BY(write_mutex_) = false;
  Mutex finish_mutex_;  // also held while reader_ is joined
  std::optional<absl::Status> end_ ABSL_GUARDED_BY(finish_mutex_);
};

}  // namespace

std::unique_ptr<PredictStream> Client::StreamPredict(PredictStream::OnResponse on_response,
                                                     const CallOptions& call) {
  return std::make_unique<GrpcPredictStream>(*connection_->predictions, std::move(on_response),
                                             call, connection_->authorization);
}

}  // namespace maneuver::client
