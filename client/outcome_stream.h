// Reports of outcomes over one stream.
//
//   auto stream = client->StreamOutcomes([&](const auto& report, const auto& answer) { ... });
//   for (v1::ReportOutcomesRequest& report : reports) {
//     if (!stream->Send(std::move(report)).ok()) break;
//   }
//   absl::Status end = stream->Finish();

#ifndef MANEUVER_CLIENT_OUTCOME_STREAM_H_
#define MANEUVER_CLIENT_OUTCOME_STREAM_H_

#include <functional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/outcome_service.pb.h"

namespace maneuver::client {

// Sends reports while earlier ones are being scored, and holds at most four that have no answer.
// When the stream breaks, opens another one and sends these again. When the server has too much to do
// for a report, waits and sends that one again. It counts each once. Both go on for
// ClientOptions::upload_patience after the last answer. For use by one thread.
class OutcomeStream {
 public:
  // Called by Send and Finish for each report, in order: with its scores, or with why the server
  // scored nothing of it. Must not call the stream.
  using OnAnswer = std::function<void(const v1::ReportOutcomesRequest& report,
                                      const absl::StatusOr<v1::ReportOutcomesResponse>& answer)>;

  // Cancels what is in flight, unless Finish was called.
  virtual ~OutcomeStream() = default;

  // Sends a report. Waits while four reports have no answer. An error ends the stream, and reports
  // without an answer may or may not have been counted: the last failure once retries have run out;
  // DEADLINE_EXCEEDED if the server took too long to take a report or to answer it; UNIMPLEMENTED
  // from a server that has no streams; CANCELLED. FAILED_PRECONDITION after Finish.
  virtual absl::Status Send(v1::ReportOutcomesRequest report) = 0;

  // Waits for the answers to all reports. Errors are those of Send; OK: each report was answered.
  virtual absl::Status Finish() = 0;
};

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_OUTCOME_STREAM_H_
