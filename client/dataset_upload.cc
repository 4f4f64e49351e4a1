#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/connection.h"

namespace maneuver::client {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kChunkBytes = 512 * 1024;

// Reads dataset.json and checks that all shards of the folder have the sizes it states.
absl::StatusOr<v1::Dataset> ReadWholeFolder(const fs::path& folder) {
  std::ifstream file(folder / "dataset.json", std::ios::binary);
  if (!file) {
    return absl::NotFoundError(
        absl::StrCat(folder.string(), " is not a dataset folder: it has no dataset.json"));
  }
  std::ostringstream text;
  text << file.rdbuf();
  v1::Dataset dataset;
  if (!google::protobuf::util::JsonStringToMessage(text.str(), &dataset).ok()) {
    return absl::DataLossError(
        absl::StrCat((folder / "dataset.json").string(), " is damaged: it does not parse"));
  }
  for (const v1::Shard& shard : dataset.shards()) {
    std::error_code error;
    const auto size = fs::file_size(folder / shard.file(), error);
    if (error || static_cast<int64_t>(size) != shard.size_bytes()) {
      return absl::DataLossError(absl::StrCat(
          (folder / shard.file()).string(), error ? " is missing" : " has another size",
          "; dataset.json says ", shard.size_bytes(), " bytes"));
    }
  }
  return dataset;
}

// The dataset of one call of UploadDataset, and its progress.
class Upload {
 public:
  Upload(fs::path folder, std::string name, v1::Dataset dataset,
         const Client::OnUploaded& on_progress)
      : folder_(std::move(folder)),
        name_(std::move(name)),
        dataset_(std::move(dataset)),
        on_progress_(on_progress) {
    for (const v1::Shard& shard : dataset_.shards()) progress_.total += shard.size_bytes();
  }

  v1::QueryUploadRequest Question() const {
    v1::QueryUploadRequest request;
    request.set_name(name_);
    *request.mutable_dataset() = dataset_;
    return request;
  }

  // Returns INTERNAL for an answer that does not match the question.
  absl::Status TakeAnswer(const v1::QueryUploadResponse& answer) {
    if (answer.arrived_bytes_size() != dataset_.shards_size()) {
      return absl::InternalError("the server answered for another number of shards");
    }
    int64_t there = 0;
    for (int i = 0; i < dataset_.shards_size(); ++i) {
      const int64_t bytes = answer.arrived_bytes(i);
      if (bytes < 0 || bytes > dataset_.shards(i).size_bytes()) {
        return absl::InternalError("the server has more of a shard than there is");
      }
      there += bytes;
    }
    arrived_ = answer.arrived_bytes();
    if (!std::exchange(has_asked_, true)) progress_.resumed = there;
    skipped_ = there;
    ShowProgress(there);
    return absl::OkStatus();
  }

  // Returns the bytes that need not be sent, by the latest answer.
  int64_t skipped() const { return skipped_; }

  // Sends what has not arrived. Stops when the stream accepts no more; Finish has the reason.
  // Returns an error only for the folder.
  absl::Status Send(grpc::ClientWriter<v1::UploadDatasetRequest>* writer) {
    v1::UploadDatasetRequest first;
    first.mutable_header()->set_name(name_);
    *first.mutable_header()->mutable_dataset() = dataset_;
    *first.mutable_header()->mutable_arrived_bytes() = arrived_;
    if (!writer->Write(first)) return absl::OkStatus();
    for (int i = 0; i < dataset_.shards_size(); ++i) {
      const absl::StatusOr<bool> more = SendShard(dataset_.shards(i), arrived_.Get(i), writer);
      if (!more.ok()) return more.status();
      if (!*more) return absl::OkStatus();
    }
    writer->WritesDone();
    return absl::OkStatus();
  }

 private:
  // Returns false once the stream accepts no more.
  absl::StatusOr<bool> SendShard(const v1::Shard& shard, int64_t offset,
                                 grpc::ClientWriter<v1::UploadDatasetRequest>* writer) {
    const fs::path file = folder_ / shard.file();
    if (offset == shard.size_bytes()) return true;
    std::ifstream bytes(file, std::ios::binary);
    bytes.seekg(offset);
    for (int64_t left = shard.size_bytes() - offset; left > 0;) {
      const int64_t count = std::min(left, kChunkBytes);
      v1::UploadDatasetRequest message;
      std::string* chunk = message.mutable_chunk();
      chunk->resize(static_cast<size_t>(count));
      if (!bytes.read(chunk->data(), count)) {
        return absl::DataLossError(absl::StrCat(file.string(), " cannot be read to its end"));
      }
      if (!writer->Write(message)) return false;
      left -= count;
      ShowProgress(progress_.there + count);
    }
    return true;
  }

  void ShowProgress(int64_t there) {
    progress_.there = there;
    if (on_progress_) on_progress_(progress_);
  }

  const fs::path folder_;
  const std::string name_;
  const v1::Dataset dataset_;
  const Client::OnUploaded& on_progress_;
  UploadProgress progress_;
  google::protobuf::RepeatedField<int64_t> arrived_;  // [shards] bytes
  int64_t skipped_ = 0;
  bool has_asked_ = false;
};

}  // namespace

absl::StatusOr<v1::Dataset> Client::UploadDataset(const std::string& folder,
                                                  const std::string& name,
                                                  const OnUploaded& on_progress,
                                                  const CallOptions& call) {
  absl::StatusOr<v1::Dataset> dataset = ReadWholeFolder(folder);
  if (!dataset.ok()) return dataset.status();
  const ClientOptions& options = connection_->options;
  const absl::Time deadline = absl::Now() + call.timeout.value_or(options.deadlines.upload);
  Upload upload(folder, name, *std::move(dataset), on_progress);
  v1::Dataset committed;
  bool is_done = false;
  bool has_sent = false;
  absl::Status folder_error;

  // Calls `method` with a context of its own.
  const auto with_context = [&](const auto& method) {
    grpc::ClientContext context;
    connection_->Introduce(context);
    context.set_deadline(absl::ToChronoTime(deadline));
    const Cancellation::Registration registration(call.cancellation,
                                                  [&context] { context.TryCancel(); });
    return method(context);
  };
  const auto ask = [&](grpc::ClientContext& context) {
    v1::QueryUploadResponse answer;
    absl::Status status =
        ToRetriable(connection_->datasets->QueryUpload(&context, upload.Question(), &answer),
                    call.cancellation);
    // A server without QueryUpload keeps nothing.
    if (absl::IsUnimplemented(status)) {
      const int shards = upload.Question().dataset().shards_size();
      answer.mutable_arrived_bytes()->Resize(shards, 0);
      status = absl::OkStatus();
    }
    // This call's data was committed and the answer was lost.
    is_done = status.ok() && has_sent && answer.has_committed();
    if (is_done) committed = answer.committed();
    return status.ok() ? upload.TakeAnswer(answer) : status;
  };
  const auto send = [&](grpc::ClientContext& context) {
    const auto writer = connection_->datasets->UploadDataset(&context, &committed);
    has_sent = true;
    folder_error = upload.Send(writer.get());
    if (!folder_error.ok()) context.TryCancel();
    const grpc::Status end = writer->Finish();  // also says why it accepted no more
    const absl::Status status =
        folder_error.ok() ? ToRetriable(end, call.cancellation) : ToStatus(end);
    is_done = status.ok();
    return status;
  };

  int64_t most_arrived = 0;
  bool may_start_clean = true;
  for (;;) {
    // At first the upload has the retries of any call. Each byte that arrives extends them.
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
    if (!folder_error.ok()) return folder_error;
    if (is_done) return committed;
    most_arrived = std::max(most_arrived, upload.skipped());
    // An earlier part was wrong and has been discarded.
    const bool starts_clean =
        absl::IsDataLoss(status) && upload.skipped() > 0 && std::exchange(may_start_clean, false);
    if (!status.ok() && !starts_clean) return status;
  }
}

}  // namespace maneuver::client
