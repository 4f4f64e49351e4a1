// StreamOutcomes: reports of outcomes on one stream, answered in their order.

#ifndef MANEUVER_SERVER_RPC_OUTCOME_STREAM_H_
#define MANEUVER_SERVER_RPC_OUTCOME_STREAM_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <memory>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "locks/mutex.h"
#include "server/rpc/open_streams.h"
#include "server/rpc/outcome_scorer.h"
#include "server/security/access_control.h"

namespace maneuver::rpc {

// Reads the next report only after the last one was scored and its answer was taken, so a stream
// holds one report or one answer. Lives until gRPC has finished it.
class OutcomeStream final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>,
                            public OpenStream,
                            public std::enable_shared_from_this<OutcomeStream> {
 public:
  // Opens a stream. Each of its reports is admitted separately. The stream ends when the caller's
  // token is revoked. All arguments must outlive the stream.
  static OutcomeStream* Open(OutcomeScorer& scorer, OpenStreams& streams,
                             grpc::CallbackServerContext* rpc);

  void Drain() override;

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnDone() override;

 private:
  OutcomeStream(OutcomeScorer& scorer, OpenStreams& streams, grpc::CallbackServerContext* rpc);

  // Called each time the token is found revoked. The first call ends the stream once no report is
  // being scored. The second call cancels the RPC of a caller that does not read.
  void OnRefused(const absl::Status& refusal);
  // Returns the request_id of the report in message_; "" if it has none that is valid.
  std::string ReportId() const;
  // Parses message_, if the memory allows.
  absl::Status ParseReport(v1::StreamOutcomesRequest* request);
  // Scores the report in message_. Runs on a thread of the scorer's pool.
  void ScoreReport();
  // Sends the answer: scores, or an error.
  void Answer(const v1::StreamOutcomesResponse& answer);
  // Reads the next report, unless the stream has to end.
  void ReadOn();
  // Finishes the call. The step that works on a report calls it, or, while a read is pending, the
  // method that ended the read; never both.
  void End(const absl::Status& status);

  OutcomeScorer& scorer_;
  OpenStreams& streams_;
  grpc::CallbackServerContext* const rpc_;
  const security::Credentials caller_;

  // Used by one step at a time: reading, scoring or writing.
  grpc::ByteBuffer message_;          // a report, then its answer
  std::shared_ptr<void> memory_;      // of the report
  serving::SendMemory::Share share_;  // of the answer
  bool has_place_ = false;            // in the pool

  // A read is in progress. Whoever sets this to false continues: OnReadDone, Drain or OnRefused.
  std::atomic<bool> reading_ = false;
  Mutex mutex_;
  absl::Status early_end_ ABSL_GUARDED_BY(mutex_);  // why no further report is read; OK: none
  bool refused_ ABSL_GUARDED_BY(mutex_) = false;
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;

  // Last, so that it is destroyed first and calls no destroyed object.
  std::unique_ptr<security::AccessControl::LongCall> admission_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_OUTCOME_STREAM_H_
