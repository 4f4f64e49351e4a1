// Private to the library: the predictions of one client that are under way.

#ifndef MANEUVER_CLIENT_PENDING_PREDICTIONS_H_
#define MANEUVER_CLIENT_PENDING_PREDICTIONS_H_

#include <grpcpp/alarm.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "absl/status/status.h"
#include "client/cancellation.h"
#include "client/prepared_prediction.h"

namespace maneuver::client {

struct PreparedPrediction::Message {
  std::string method;  // "/maneuver.v1.PredictionService/Predict"
  grpc::ByteBuffer request;
};

// One thread takes all answers, however many calls wait for theirs. Thread-safe.
class PendingPredictions {
 public:
  explicit PendingPredictions(std::shared_ptr<grpc::ChannelInterface> channel);
  // Cancels what is under way and waits for it.
  ~PendingPredictions();

  struct Call;
  // `call`, with its message, context and on_answer filled in, is on its way when this returns.
  void Start(std::unique_ptr<Call> call, Cancellation* callers_cancellation);
  // Is not sent: it is answered with `status`, on the thread of all answers.
  void Refuse(std::unique_ptr<Call> call, absl::Status status);

 private:
  void Count();
  void TakeAnswers();

  grpc::TemplatedGenericStub<grpc::ByteBuffer, v1::PredictResponse> stub_;
  grpc::CompletionQueue queue_;
  Cancellation cancellation_;
  std::mutex mutex_;  // guards what follows
  std::condition_variable changed_;
  int under_way_ = 0;
  std::thread taker_;  // from the first call on
};

struct PendingPredictions::Call {
  std::shared_ptr<const PreparedPrediction::Message> message;
  grpc::ClientContext context;
  OnPrediction on_answer;
  std::function<void(const absl::Status&)> on_end = {};  // told before on_answer; may be empty

  v1::PredictResponse response;
  grpc::Status status;
  absl::Status refusal;                // of a call that is not sent
  std::unique_ptr<grpc::Alarm> alarm;  // likewise: goes off at once
  std::unique_ptr<grpc::ClientAsyncResponseReader<v1::PredictResponse>> reader;
  std::unique_ptr<Cancellation::Registration> registration;
  std::unique_ptr<Cancellation::Registration> callers_registration;
};

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_PENDING_PREDICTIONS_H_
