// Private to the library: one client's predictions in progress.

#ifndef MANEUVER_CLIENT_PENDING_PREDICTIONS_H_
#define MANEUVER_CLIENT_PENDING_PREDICTIONS_H_

#include <grpcpp/alarm.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "client/cancellation.h"
#include "client/prepared_prediction.h"
#include "locks/mutex.h"

namespace maneuver::client {

struct PreparedPrediction::Message {
  std::string method;  // "/maneuver.v1.PredictionService/Predict"
  grpc::ByteBuffer request;
};

// One thread takes all answers, whatever their number. Thread-safe.
class PendingPredictions {
 public:
  explicit PendingPredictions(std::shared_ptr<grpc::ChannelInterface> channel);
  // Cancels calls in progress and waits for them.
  ~PendingPredictions();

  struct Call;
  // Sends `call`, whose message, context and on_answer must be set. Does not wait.
  void Start(std::unique_ptr<Call> call, Cancellation* callers_cancellation);
  // Answers `call` with `status` without sending it, on the thread of all answers.
  void Refuse(std::unique_ptr<Call> call, absl::Status status);

 private:
  void Count() ABSL_LOCKS_EXCLUDED(mutex_);
  void TakeAnswers();

  grpc::TemplatedGenericStub<grpc::ByteBuffer, v1::PredictResponse> stub_;
  grpc::CompletionQueue queue_;
  Cancellation cancellation_;
  Mutex mutex_;
  CondVar changed_;
  int under_way_ ABSL_GUARDED_BY(mutex_) = 0;
  std::thread taker_ ABSL_GUARDED_BY(mutex_);  // starts with the first call
};

struct PendingPredictions::Call {
  std::shared_ptr<const PreparedPrediction::Message> message;
  grpc::ClientContext context;
  OnPrediction on_answer;
  std::function<void(const absl::Status&)> on_end = {};  // called before on_answer; may be empty

  v1::PredictResponse response;
  grpc::Status status;
  absl::Status refusal;                // of a call that is not sent
  std::unique_ptr<grpc::Alarm> alarm;  // of a call that is not sent: fires at once
  std::unique_ptr<grpc::ClientAsyncResponseReader<v1::PredictResponse>> reader;
  std::unique_ptr<Cancellation::Registration> registration;
  std::unique_ptr<Cancellation::Registration> callers_registration;
};

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_PENDING_PREDICTIONS_H_
