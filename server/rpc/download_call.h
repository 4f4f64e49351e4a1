// One call that downloads files: a header, then chunks. Private to rpc/.

#ifndef MANEUVER_SERVER_RPC_DOWNLOAD_CALL_H_
#define MANEUVER_SERVER_RPC_DOWNLOAD_CALL_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "locks/mutex.h"
#include "server/rpc/blocking_call.h"
#include "server/rpc/guarded_service.h"
#include "server/security/access_control.h"

namespace maneuver::rpc {

// Reads the disk only after the client has taken the previous chunk, so a slow client costs one
// chunk, which counts as send memory, and delays nobody. Deletes itself.
//   Response: has header() or chunk(). Reader: has header() and Next, a StatusOr<std::string> which
//   is empty at the end.
template <typename Response, typename Reader>
class DownloadCall : public grpc::ServerWriteReactor<Response> {
 public:
  void OnWriteDone(bool ok) final {
    if (!ok) return End(absl::CancelledError("the download was cancelled"));
    blocking_.pool.Continue([this] { TakeStep(); });
  }
  void OnDone() final { delete this; }

 protected:
  DownloadCall(const BlockingWork& blocking, grpc::CallbackServerContext* rpc)
      : blocking_(blocking), rpc_(rpc) {}

  // Begins the call; the last thing that a constructor does.
  //   method: "/maneuver.v1.ModelService/DownloadModelVersion".
  void Start(security::AccessControl& access, std::string_view method) {
    admission_ = access.Watch(method, CredentialsOf(*rpc_),
                              [this](const absl::Status& refusal) { OnRefused(refusal); });
    const absl::Status room = blocking_.send_memory.CheckRoom();
    if (!room.ok()) {
      End(room);
    } else if (!blocking_.pool.Post([this] { TakeStep(); })) {
      End(Busy());
    }
  }

  // Opens the files to send. Leaves out the bytes that the client already has, as its request says.
  virtual absl::StatusOr<std::unique_ptr<Reader>> Open() = 0;
  // Adds the ErrorInfo that fits an error.
  virtual absl::Status WithReason(absl::Status status) const = 0;

 private:
  // Called each time the token is found revoked. The first call ends the download before its next
  // chunk. The second call cancels the RPC of a client that does not read.
  void OnRefused(const absl::Status& refusal) {
    const MutexLock lock(mutex_);
    const bool again = !std::exchange(refusal_, refusal).ok();
    if (again && !has_ended_) rpc_->TryCancel();
  }

  // Runs one step on a thread of the pool; never two at a time.
  void TakeStep() {
    absl::Status refusal;
    {
      const MutexLock lock(mutex_);
      refusal = refusal_;
    }
    if (!refusal.ok()) return End(refusal);
    const absl::StatusOr<bool> more = ReadNext();
    if (!more.ok()) return End(errors::WithStorageReason(WithReason(more.status())));
    if (!*more) return End(absl::OkStatus());
    share_ = blocking_.send_memory.Take(static_cast<int64_t>(message_.ByteSizeLong()));
    this->StartWrite(&message_);
  }

  // Fills message_. Returns false at the end.
  absl::StatusOr<bool> ReadNext() {
    if (reader_ == nullptr) {
      auto reader = Open();
      if (!reader.ok()) return reader.status();
      reader_ = *std::move(reader);
      *message_.mutable_header() = reader_->header();
      return true;
    }
    auto bytes = reader_->Next();
    if (!bytes.ok()) return bytes.status();
    const bool more = !bytes->empty();
    message_.set_chunk(*std::move(bytes));
    return more;
  }

  void End(const absl::Status& status) {
    {
      const MutexLock lock(mutex_);
      has_ended_ = true;
    }
    this->Finish(ToGrpcStatus(status));
  }

  const BlockingWork blocking_;
  grpc::CallbackServerContext* const rpc_;

  // Used only by the step in progress.
  std::unique_ptr<Reader> reader_;
  Response message_;
  serving::SendMemory::Share share_;  // of message_

  Mutex mutex_;
  absl::Status refusal_ ABSL_GUARDED_BY(mutex_);
  bool has_ended_ ABSL_GUARDED_BY(mutex_) = false;

  // Last, so that it is destroyed first and calls no destroyed object.
  std::unique_ptr<security::AccessControl::LongCall> admission_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_DOWNLOAD_CALL_H_
