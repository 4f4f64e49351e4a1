// One call that uploads files: a header, then chunks. Private to rpc/.

#ifndef MANEUVER_SERVER_RPC_UPLOAD_CALL_H_
#define MANEUVER_SERVER_RPC_UPLOAD_CALL_H_

#include <grpcpp/impl/codegen/proto_utils.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <memory>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "locks/mutex.h"
#include "server/rpc/blocking_call.h"
#include "server/rpc/guarded_service.h"
#include "server/rpc/request_outline.h"
#include "server/security/access_control.h"

namespace maneuver::rpc {

inline constexpr size_t kMaxUploadChunk = size_t{1} << 20;  // bytes

// Checks arrived_bytes: it must be empty, or have a number from 0 to the file's size for each file.
// INVALID_ARGUMENT names header.arrived_bytes.
//   noun: what a file is called, "shard". File has size_bytes().
template <typename Files, typename Numbers>
absl::Status CheckArrived(const Files& files, const Numbers& arrived, absl::string_view noun) {
  if (arrived.empty()) return absl::OkStatus();
  if (arrived.size() != files.size()) {
    return errors::InvalidField("header.arrived_bytes",
                                absl::StrCat("must be empty or have a number for each of the ",
                                             files.size(), " ", noun, "s"));
  }
  for (int i = 0; i < arrived.size(); ++i) {
    const int64_t size = files.Get(i).size_bytes();
    if (arrived.Get(i) >= 0 && arrived.Get(i) <= size) continue;
    return errors::InvalidField(absl::StrCat("header.arrived_bytes[", i, "]"),
                                absl::StrCat("must be from 0 to the ", noun, "'s size, ", size));
  }
  return absl::OkStatus();
}

// Reads the next message only after the last was handed to the disk, so a fast client waits for a
// slow disk. Receives and answers bytes, so that a message that would take too much memory is refused
// before it is parsed. Deletes itself.
//   Request: has header() or chunk(). Upload: has Append, Commit (a StatusOr<Response>), Discard.
template <typename Request, typename Response, typename Upload>
class UploadCall : public grpc::ServerReadReactor<grpc::ByteBuffer> {
 public:
  void OnReadDone(bool ok) final {
    if (!reading_.exchange(false)) return;  // the call was refused
    const auto step = [this, ok] { TakeStep(ok); };
    if (upload_ != nullptr) {
      blocking_.pool.Continue(step);
    } else if (!blocking_.pool.Post(step)) {
      End(Busy());
    }
  }
  void OnDone() final { delete this; }

 protected:
  UploadCall(const BlockingWork& blocking, grpc::CallbackServerContext* rpc,
             grpc::ByteBuffer* response)
      : blocking_(blocking), rpc_(rpc), response_(response) {}

  // Begins the call; the last thing that a constructor does.
  //   method: "/maneuver.v1.DatasetService/UploadDataset".
  void Start(security::AccessControl& access, std::string_view method) {
    admission_ = access.Watch(method, CredentialsOf(*rpc_),
                              [this](const absl::Status& refusal) { OnRefused(refusal); });
    ReadOn();
  }

  // Returns the upload that a header begins.
  virtual absl::StatusOr<std::unique_ptr<Upload>> Begin(const Request& first) = 0;
  // Adds the ErrorInfo that fits an error of the upload.
  virtual absl::Status WithReason(absl::Status status) const = 0;

 private:
  // Called when the caller's token is revoked: the call ends as soon as nobody works on it.
  void OnRefused(const absl::Status& refusal) {
    {
      const MutexLock lock(mutex_);
      refusal_ = refusal;
      if (!reading_.exchange(false)) return;  // the thread that works on the call will see it
    }
    // The read that is left pending ends with the call.
    blocking_.pool.Continue([this, refusal] { EndRefused(refusal); });
  }

  // Runs one step on a thread of the pool; never two at a time.
  void TakeStep(bool has_message) {
    const absl::Status status = has_message ? TakeMessage() : Commit();
    if (status.ok() && has_message) {
      ReadOn();
    } else {
      End(status);
    }
  }

  void ReadOn() {
    absl::Status refusal;
    {
      // The lock keeps out a refusal. OnReadDone may run at once, but takes the lock for the first
      // message alone, which gRPC does not read before the call is handed over.
      const MutexLock lock(mutex_);
      refusal = refusal_;
      if (refusal.ok()) {
        reading_ = true;
        StartRead(&message_);
      }
    }
    if (!refusal.ok()) EndRefused(refusal);
  }

  void EndRefused(const absl::Status& refusal) {
    // A caller that may not upload may leave nothing here either.
    if (upload_ != nullptr) upload_->Discard();
    End(refusal);
  }

  void End(const absl::Status& status) {
    // Ends the upload before the client learns of the end and asks what has arrived.
    upload_.reset();
    {
      const MutexLock lock(mutex_);  // ReadOn, on another thread, has released it
    }
    Finish(ToGrpcStatus(status));
  }

  absl::Status TakeMessage() { return upload_ == nullptr ? TakeHeader() : TakeChunk(); }

  absl::Status TakeHeader() {
    absl::Status status = CheckDensity(*Request::descriptor(), message_);
    if (!status.ok()) return status;
    // Kept until the upload has begun.
    const auto room = blocking_.send_memory.AdmitRequest(static_cast<int64_t>(message_.Length()));
    if (!room.ok()) return room.status();
    Request first;
    if (!Parse(&first)) return errors::MalformedMessage();
    if (!first.has_header()) return HeaderMissing();
    auto upload = Begin(first);
    if (!upload.ok()) return WithReason(upload.status());
    upload_ = *std::move(upload);
    return absl::OkStatus();
  }

  absl::Status TakeChunk() {
    constexpr size_t kFrame = 16;  // bytes; those around the chunk are fewer
    const absl::Status too_large = errors::InvalidField("chunk", "must have at most 1 MiB");
    if (message_.Length() > kMaxUploadChunk + kFrame) return too_large;
    Request next;
    if (!Parse(&next)) return errors::MalformedMessage();
    if (next.has_header()) {
      return errors::InvalidField("header", "must be the first message alone");
    }
    if (next.chunk().size() > kMaxUploadChunk) return too_large;
    return WithReason(upload_->Append(next.chunk()));
  }

  // Lets go of the bytes.
  bool Parse(Request* request) {
    return grpc::SerializationTraits<Request>::Deserialize(&message_, request).ok();
  }

  absl::Status Commit() {
    // A broken stream ends like one that the client closed.
    if (rpc_->IsCancelled()) return absl::CancelledError("the upload was broken off");
    if (upload_ == nullptr) return HeaderMissing();
    auto committed = upload_->Commit();
    if (!committed.ok()) return WithReason(committed.status());
    bool own = false;
    grpc::SerializationTraits<Response>::Serialize(*committed, response_, &own);
    return absl::OkStatus();
  }

  static absl::Status HeaderMissing() {
    return errors::InvalidField("header", "must be the first message of an upload");
  }

  const BlockingWork blocking_;
  grpc::CallbackServerContext* const rpc_;
  grpc::ByteBuffer* const response_;
  grpc::ByteBuffer message_;
  std::unique_ptr<Upload> upload_;  // from the header on; used by the step in progress alone

  // A read is in progress. Whoever sets this to false continues the call: OnReadDone or a refusal.
  std::atomic<bool> reading_ = false;
  Mutex mutex_;
  absl::Status refusal_ ABSL_GUARDED_BY(mutex_);

  // Last, so that it is destroyed first and calls no destroyed object.
  std::unique_ptr<security::AccessControl::LongCall> admission_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_UPLOAD_CALL_H_
