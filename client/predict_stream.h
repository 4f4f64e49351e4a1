// Predictions for a planner's control loop, over one stream.
//
//   auto stream = client->StreamPredict([&](const v1::StreamPredictResponse& answer) { ... });
//   while (driving) {
//     stream->Send(std::to_string(cycle++), request, absl::Milliseconds(80)).IgnoreError();
//   }
//   absl::Status end = stream->Finish();

#ifndef MANEUVER_CLIENT_PREDICT_STREAM_H_
#define MANEUVER_CLIENT_PREDICT_STREAM_H_

#include <functional>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "maneuver/v1/prediction_service.pb.h"

namespace maneuver::client {

// Many requests in flight, each answered when ready, under its request_id. Thread-safe.
class PredictStream {
 public:
  // Called for each answer, one at a time, on a thread of the stream. Must not call Finish.
  using OnResponse = std::function<void(const v1::StreamPredictResponse&)>;

  // Cancels what is in flight, unless Finish was called.
  virtual ~PredictStream() = default;

  // Sends a request. Returns when it is on its way: waits while the server reads no further
  // request. UNAVAILABLE once the stream is broken; Finish then says why, and a new stream is
  // needed. FAILED_PRECONDITION after Finish.
  //   timeout: the server gives up on this request this long after it arrives; unset: never.
  virtual absl::Status Send(const std::string& request_id, const v1::PredictRequest& request,
                            std::optional<absl::Duration> timeout = std::nullopt) = 0;

  // Ends the requests, waits for the answers in flight, and returns how the stream ended. A second
  // call returns the same.
  virtual absl::Status Finish() = 0;

  // Ends the stream at once. Finish then returns CANCELLED.
  virtual void Cancel() = 0;
};

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_PREDICT_STREAM_H_
