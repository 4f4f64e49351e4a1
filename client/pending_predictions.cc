#include "client/pending_predictions.h"

#include <utility>

#include "client/connection.h"

namespace maneuver::client {
namespace {

const char* MethodName(PredictionMethod method) {
  switch (method) {
    case PredictionMethod::kPredictActionProbabilities:
      return "/maneuver.v1.PredictionService/PredictActionProbabilities";
    case PredictionMethod::kPredictActionDistributions:
      return "/maneuver.v1.PredictionService/PredictActionDistributions";
    case PredictionMethod::kPredict:
      break;
  }
  return "/maneuver.v1.PredictionService/Predict";
}

}  // namespace

// The requests of the three methods have the same fields under the same numbers; that for
// probabilities has no query.
PreparedPrediction::PreparedPrediction(const v1::PredictRequest& request, PredictionMethod method) {
  auto message = std::make_shared<Message>();
  message->method = MethodName(method);
  std::string bytes = request.SerializeAsString();
  if (method == PredictionMethod::kPredictActionProbabilities && request.has_query()) {
    v1::PredictRequest without_query = request;
    without_query.clear_query();
    bytes = without_query.SerializeAsString();
  }
  const grpc::Slice slice(bytes);
  message->request = grpc::ByteBuffer(&slice, 1);
  message_ = std::move(message);
}

size_t PreparedPrediction::bytes() const { return message_->request.Length(); }

PendingPredictions::PendingPredictions(std::shared_ptr<grpc::ChannelInterface> channel)
    : stub_(std::move(channel)) {}

PendingPredictions::~PendingPredictions() {
  cancellation_.Cancel();
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return under_way_ == 0; });
  }
  queue_.Shutdown();
  if (taker_.joinable()) taker_.join();
}

void PendingPredictions::Start(std::unique_ptr<Call> call, Cancellation* callers_cancellation) {
  {
    const std::lock_guard lock(mutex_);
    ++under_way_;
    if (!taker_.joinable()) taker_ = std::thread([this] { TakeAnswers(); });
  }
  const auto cancel = [context = &call->context] { context->TryCancel(); };
  call->registration = std::make_unique<Cancellation::Registration>(&cancellation_, cancel);
  if (callers_cancellation != nullptr) {
    call->callers_registration =
        std::make_unique<Cancellation::Registration>(callers_cancellation, cancel);
  }
  call->reader = stub_.PrepareUnaryCall(&call->context, call->message->method,
                                        call->message->request, &queue_);
  call->reader->StartCall();
  // From here on it belongs to the thread that takes its answer.
  Call* const started = call.release();
  started->reader->Finish(&started->response, &started->status, started);
}

void PendingPredictions::TakeAnswers() {
  void* tag = nullptr;
  bool ok = false;
  while (queue_.Next(&tag, &ok)) {
    std::unique_ptr<Call> call(static_cast<Call*>(tag));
    // The caller's goes when the call has ended.
    call->callers_registration.reset();
    if (call->status.ok()) {
      call->on_answer(std::move(call->response));
    } else {
      call->on_answer(ToStatus(call->status));
    }
    call.reset();
    const std::lock_guard lock(mutex_);
    if (--under_way_ == 0) changed_.notify_all();
  }
}

}  // namespace maneuver::client
