// StreamPredict: many requests in flight on one stream, answered as they finish.
//
// A stream reads no further request while 64 requests, 8 MiB of requests and answers, or answers of
// up to 64 MiB that are being computed are in flight: flow control then makes the caller wait. A
// request_id has at most 128 characters.

#ifndef MANEUVER_SERVER_RPC_PREDICT_STREAM_H_
#define MANEUVER_SERVER_RPC_PREDICT_STREAM_H_

#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <deque>
#include <memory>
#include <optional>
#include <set>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "server/rpc/open_streams.h"
#include "server/rpc/prediction_run.h"

namespace maneuver::rpc {

// Returns the inputs and outputs of a run for Predict's request and response.
PredictionIo PredictIo(const v1::PredictRequest& request, v1::PredictResponse* response);

// A stream lives until gRPC has finished it, which is after its last request was answered.
class PredictStream final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>,
                            public OpenStream,
                            public std::enable_shared_from_this<PredictStream> {
 public:
  // Opens a stream. Each of its requests is admitted separately. The stream ends when the caller's
  // token is revoked. `streams` must outlive the stream.
  static PredictStream* Open(PredictionContext& context, OpenStreams& streams,
                             grpc::CallbackServerContext* rpc);

  // Accepts no more requests, answers those in flight, and ends with UNAVAILABLE, so that the
  // caller opens another stream elsewhere.
  void Drain() override;

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

 private:
  struct Messages {
    v1::StreamPredictRequest request;
    v1::StreamPredictResponse response;
  };
  // One request in flight, from its arrival until its answer was written.
  struct Entry {
    grpc::ByteBuffer bytes;  // of the request, then of the response
    size_t size = 0;         // of `bytes`
    std::shared_ptr<Messages> messages = std::make_shared<Messages>();  // until it is answered
    std::shared_ptr<PredictionRun> run;                                 // until it is answered
    int64_t expected = 0;               // upper bound on the answer's bytes
    serving::SendMemory::Share memory;  // of the answer
  };

  PredictStream(PredictionContext& context, OpenStreams& streams, grpc::CallbackServerContext* rpc);

  // Called each time the token is found revoked. The first call ends the stream once nothing is in
  // flight. The second call cancels the RPC of a caller that does not read.
  void OnRefused(const absl::Status& refusal);
  void Begin(std::shared_ptr<Entry> entry);
  // Checks a request's outline, parses it and hands it to the scheduler.
  absl::Status Start(const std::shared_ptr<Entry>& entry);
  void Answered(std::shared_ptr<Entry> entry, const absl::Status& status);
  // What the stream does next: writing, finishing or neither.
  struct Step {
    const grpc::ByteBuffer* write = nullptr;
    std::optional<absl::Status> finish = {};
  };
  // Begins to read if the state allows it, and returns what else it allows. Call it under the same
  // lock as the change of state.
  Step NextStep() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Carries out a step. Call it without the lock, because gRPC may call back at once.
  void Take(const Step& step) ABSL_LOCKS_EXCLUDED(mutex_);

  PredictionContext& context_;
  OpenStreams& streams_;
  grpc::CallbackServerContext* const rpc_;
  const security::Credentials caller_;
  std::unique_ptr<security::AccessControl::LongCall> admission_;  // until OnDone

  Mutex mutex_;
  std::shared_ptr<Entry> reading_ ABSL_GUARDED_BY(mutex_);
  bool read_pending_ ABSL_GUARDED_BY(mutex_) = false;
  bool reads_ended_ ABSL_GUARDED_BY(mutex_) = false;  // the caller sends no more, or has gone
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  bool draining_ ABSL_GUARDED_BY(mutex_) = false;
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
  absl::Status refusal_ ABSL_GUARDED_BY(mutex_);
  size_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;            // sum of `size` over all entries below
  int64_t expected_bytes_ ABSL_GUARDED_BY(mutex_) = 0;  // sum of `expected` over in_flight_
  std::set<std::shared_ptr<Entry>> in_flight_ ABSL_GUARDED_BY(mutex_);
  std::deque<std::shared_ptr<Entry>> to_write_ ABSL_GUARDED_BY(mutex_);
  std::shared_ptr<Entry> writing_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_PREDICT_STREAM_H_
