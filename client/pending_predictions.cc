#include "client/pending_predictions.h"

#include <utility>

#include "client/call_status.h"

namespace maneuver::client {
namespace {

template <typename Request>
Request WithoutQuery(const v1::PredictRequest& request) {
  Request result;
  result.set_model(request.model());
  *result.mutable_scenarios() = request.scenarios();
  result.set_priority(request.priority());
  result.set_include_action_names(request.include_action_names());
  *result.mutable_required_action_names() = request.required_action_names();
  result.set_strict(request.strict());
  return result;
}

grpc::ByteBuffer Serialize(const google::protobuf::MessageLite& message) {
  const grpc::Slice slice(message.SerializeAsString());
  return grpc::ByteBuffer(&slice, 1);
}

}  // namespace

PreparedPrediction::PreparedPrediction(const v1::PredictRequest& request, PredictionMethod method) {
  auto message = std::make_shared<Message>();
  const std::string service = "/maneuver.v1.PredictionService/";
  switch (method) {
    case PredictionMethod::kPredict:
      message->method = service + "Predict";
      message->request = Serialize(request);
      break;
    case PredictionMethod::kPredictActionProbabilities:
      message->method = service + "PredictActionProbabilities";
      message->request = Serialize(WithoutQuery<v1::PredictActionProbabilitiesRequest>(request));
      break;
    case PredictionMethod::kPredictActionDistributions: {
      message->method = service + "PredictActionDistributions";
      auto distributions = WithoutQuery<v1::PredictActionDistributionsRequest>(request);
      *distributions.mutable_query() = request.query();
      message->request = Serialize(distributions);
      break;
    }
  }
  message_ = std::move(message);
}

size_t PreparedPrediction::bytes() const { return message_->request.Length(); }

PendingPredictions::PendingPredictions(std::shared_ptr<grpc::ChannelInterface> channel)
    : stub_(std::move(channel)) {}

PendingPredictions::~PendingPredictions() {
  cancellation_.Cancel();
  {
    const MutexLock lock(mutex_);
    while (under_way_ > 0) changed_.Wait(mutex_);
  }
  queue_.Shutdown();
  if (taker_.joinable()) taker_.join();
}

void PendingPredictions::Count() {
  const MutexLock lock(mutex_);
  ++under_way_;
  if (!taker_.joinable()) taker_ = std::thread([this] { TakeAnswers(); });
}

void PendingPredictions::Refuse(std::unique_ptr<Call> call, absl::Status status) {
  Count();
  call->refusal = std::move(status);
  Call* const refused = call.release();
  refused->alarm = std::make_unique<grpc::Alarm>();
  refused->alarm->Set(&queue_, gpr_now(GPR_CLOCK_MONOTONIC), refused);
}

void PendingPredictions::Start(std::unique_ptr<Call> call, Cancellation* callers_cancellation) {
  Count();
  const auto cancel = [context = &call->context] { context->TryCancel(); };
  call->registration = std::make_unique<Cancellation::Registration>(&cancellation_, cancel);
  if (callers_cancellation != nullptr) {
    call->callers_registration =
        std::make_unique<Cancellation::Registration>(callers_cancellation, cancel);
  }
  call->reader = stub_.PrepareUnaryCall(&call->context, call->message->method,
                                        call->message->request, &queue_);
  call->reader->StartCall();
  // From here on, the thread that takes the answer owns it.
  Call* const started = call.release();
  started->reader->Finish(&started->response, &started->status, started);
}

void PendingPredictions::TakeAnswers() {
  void* tag = nullptr;
  bool ok = false;
  while (queue_.Next(&tag, &ok)) {
    std::unique_ptr<Call> call(static_cast<Call*>(tag));
    // The caller's registration ends with the call.
    call->callers_registration.reset();
    absl::Status status = call->refusal.ok() ? ToStatus(call->status) : std::move(call->refusal);
    if (call->on_end) call->on_end(status);
    if (status.ok()) {
      call->on_answer(std::move(call->response));
    } else {
      call->on_answer(std::move(status));
    }
    call.reset();
    const MutexLock lock(mutex_);
    if (--under_way_ == 0) changed_.NotifyAll();
  }
}

}  // namespace maneuver::client
