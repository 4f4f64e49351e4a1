#include "client/file_upload.h"

#include <algorithm>
#include <fstream>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"

namespace maneuver::client {
namespace {

constexpr int64_t kChunkBytes = 512 * 1024;

// The files of one upload, and how far they are.
class FilesOnTheirWay {
 public:
  FilesOnTheirWay(const std::vector<LocalFile>& files, const OnUploaded& on_progress)
      : files_(files), on_progress_(on_progress) {
    arrived_.Resize(static_cast<int>(files.size()), 0);
    for (const LocalFile& file : files) progress_.total += file.size_bytes;
  }

  // INTERNAL for an answer that does not fit the files.
  absl::Status TakeAnswer(const ArrivedBytes& answer) {
    if (answer.size() != static_cast<int>(files_.size())) {
      return absl::InternalError("the server answered for another number of files");
    }
    int64_t there = 0;
    for (int i = 0; i < answer.size(); ++i) {
      const int64_t bytes = answer.Get(i);
      if (bytes < 0 || bytes > files_[static_cast<size_t>(i)].size_bytes) {
        return absl::InternalError("the server has more of a file than there is");
      }
      there += bytes;
    }
    arrived_ = answer;
    // The server deletes bytes of an earlier upload that it finds to be wrong.
    progress_.resumed = has_asked_ ? std::min(progress_.resumed, there) : there;
    has_asked_ = true;
    skipped_ = there;
    ShowProgress(there);
    return absl::OkStatus();
  }

  const ArrivedBytes& arrived() const { return arrived_; }
  // Bytes that are not sent, by the last answer.
  int64_t skipped() const { return skipped_; }
  // What had arrived is thrown away.
  void Forget() { skipped_ = 0; }

  // Sends what has not arrived. False once `write` takes no more.
  absl::StatusOr<bool> Send(const UploadCalls::WriteChunk& write) {
    for (size_t i = 0; i < files_.size(); ++i) {
      auto more = SendFile(files_[i], arrived_.Get(static_cast<int>(i)), write);
      if (!more.ok() || !*more) return more;
    }
    return true;
  }

 private:
  absl::StatusOr<bool> SendFile(const LocalFile& file, int64_t offset,
                                const UploadCalls::WriteChunk& write) {
    if (offset == file.size_bytes) return true;
    std::ifstream bytes(file.path, std::ios::binary);
    bytes.seekg(offset);
    for (int64_t left = file.size_bytes - offset; left > 0;) {
      const int64_t count = std::min(left, kChunkBytes);
      std::string chunk(static_cast<size_t>(count), '\0');
      if (!bytes.read(chunk.data(), count)) {
        return absl::DataLossError(absl::StrCat(file.path, " cannot be read to its end"));
      }
      if (!write(std::move(chunk))) return false;
      left -= count;
      ShowProgress(progress_.there + count);
    }
    return true;
  }

  void ShowProgress(int64_t there) {
    progress_.there = there;
    if (on_progress_) on_progress_(progress_);
  }

  const std::vector<LocalFile>& files_;
  const OnUploaded& on_progress_;
  UploadProgress progress_;
  ArrivedBytes arrived_;
  int64_t skipped_ = 0;
  bool has_asked_ = false;
};

}  // namespace

absl::Status UploadFiles(const ClientOptions& options, const std::vector<LocalFile>& files,
                         const UploadCalls& calls,
                         const std::function<void(grpc::ClientContext&)>& introduce,
                         const OnUploaded& on_progress, const CallOptions& call) {
  const absl::Time deadline = absl::Now() + call.timeout.value_or(options.deadlines.upload);
  FilesOnTheirWay upload(files, on_progress);
  bool is_done = false;
  bool has_sent = false;
  absl::Status local_error;

  // Calls `method` with a context of its own.
  const auto with_context = [&](const auto& method) {
    grpc::ClientContext context;
    introduce(context);
    context.set_deadline(absl::ToChronoTime(deadline));
    const Cancellation::Registration registration(call.cancellation,
                                                  [&context] { context.TryCancel(); });
    return method(context);
  };
  const auto ask = [&](grpc::ClientContext& context) {
    ArrivedBytes arrived;
    bool committed = false;
    absl::Status status = ToRetriable(calls.ask(context, &arrived, &committed), call.cancellation);
    // An older server does not know this question, and keeps nothing of an interrupted upload.
    if (absl::IsUnimplemented(status)) {
      arrived.Resize(static_cast<int>(files.size()), 0);
      status = absl::OkStatus();
    }
    // The server has committed what this call or an earlier one sent, but its answer was lost.
    is_done = status.ok() && committed && (has_sent || calls.may_be_committed_before);
    return status.ok() ? upload.TakeAnswer(arrived) : status;
  };
  const auto send = [&](grpc::ClientContext& context) {
    has_sent = true;
    const grpc::Status end =
        calls.send(context, upload.arrived(), [&](const UploadCalls::WriteChunk& write) {
          const absl::StatusOr<bool> sent = upload.Send(write);
          local_error = sent.status();
          if (!sent.ok()) context.TryCancel();
          return sent.ok() && *sent;
        });
    const absl::Status status =
        local_error.ok() ? ToRetriable(end, call.cancellation) : ToStatus(end);
    is_done = status.ok();
    return status;
  };

  int64_t most_arrived = 0;
  bool may_start_clean = true;
  for (;;) {
    // Before anything is sent, the upload is retried like any call. Then it is retried until
    // nothing more has arrived for upload_patience.
    RetryPolicy policy = options.retry;
    if (has_sent) policy.max_attempts = 1'000'000;
    const bool had_sent = has_sent;
    const absl::Time give_up = std::min(deadline, absl::Now() + options.upload_patience);
    const absl::Status status =
        RetryUnavailable(policy, give_up, call.cancellation, options.on_retry, [&] {
          absl::Status result = with_context(ask);
          if (result.ok() && !is_done) result = with_context(send);
          const bool earned = upload.skipped() > most_arrived || has_sent != had_sent;
          return earned && absl::IsUnavailable(result) ? absl::OkStatus() : result;
        });
    if (!local_error.ok()) return local_error;
    if (is_done) return absl::OkStatus();
    most_arrived = std::max(most_arrived, upload.skipped());
    // The bytes of an earlier upload were wrong. The server has deleted them.
    const bool starts_clean =
        absl::IsDataLoss(status) && upload.skipped() > 0 && std::exchange(may_start_clean, false);
    if (!status.ok() && !starts_clean) return status;
    if (starts_clean) {
      upload.Forget();
      most_arrived = 0;
    }
  }
}

}  // namespace maneuver::client
