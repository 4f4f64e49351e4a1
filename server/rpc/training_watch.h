#ifndef MANEUVER_SERVER_RPC_TRAINING_WATCH_H_
#define MANEUVER_SERVER_RPC_TRAINING_WATCH_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <deque>
#include <memory>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "locks/mutex.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/supervisor.h"
#include "server/rpc/blocking_call.h"
#include "server/security/access_control.h"

namespace maneuver::rpc {

// One WatchJob call. It reads the store again only after the client has taken everything that was
// read before, so a slow client costs a small buffer, which counts as send memory, and delays
// nobody. Deletes itself.
class JobWatchCall final : public grpc::ServerWriteReactor<v1::WatchJobResponse> {
 public:
  JobWatchCall(jobs::Supervisor& jobs, const BlockingWork& blocking,
               security::AccessControl& access, grpc::CallbackServerContext* rpc,
               const v1::WatchJobRequest& request);

  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override { delete this; }

 private:
  // The phase of the call. The thread that moves it to kFinished calls Finish; no other does.
  enum class Phase {
    kWaiting,  // for news
    kWorking,  // reading or writing
    kFinished,
  };

  void OnNews();
  // Called each time the token is found revoked. The first call ends the watch once no read or
  // write is in progress. The second call cancels the RPC of a client that does not read.
  void OnRefused(const absl::Status& refusal);
  // Reads new events and writes them; waits if there are none. Runs on a thread of the pool while
  // kWorking.
  void ReadNext();
  void ReadSoon();
  void WriteNext();
  void End(const absl::Status& status);

  jobs::Supervisor& jobs_;
  const BlockingWork blocking_;
  grpc::CallbackServerContext* const rpc_;

  // Used only by the thread that moved the call to kWorking.
  std::unique_ptr<jobs::JobEventReader> reader_;
  std::deque<v1::Job> unsent_;
  serving::SendMemory::Share share_;  // of unsent_ and message_
  v1::WatchJobResponse message_;

  Mutex mutex_;
  Phase phase_ ABSL_GUARDED_BY(mutex_) = Phase::kWorking;
  bool has_news_ ABSL_GUARDED_BY(mutex_) = false;  // came while kWorking
  bool is_cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  absl::Status refusal_ ABSL_GUARDED_BY(mutex_);

  // Last, so that they are destroyed first and call no destroyed object.
  std::unique_ptr<jobs::JobNews::Subscription> subscription_;
  std::unique_ptr<security::AccessControl::LongCall> admission_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_TRAINING_WATCH_H_
