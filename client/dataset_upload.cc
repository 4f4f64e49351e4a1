#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/connection.h"

namespace maneuver::client {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kChunkBytes = 512 * 1024;

// dataset.json of a folder whose shards are all there with the sizes that it states.
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

// Sends the bytes of one shard. False once the stream takes no more.
absl::StatusOr<bool> SendShard(const fs::path& file, int64_t size,
                               grpc::ClientWriter<v1::UploadDatasetRequest>* writer,
                               const std::function<void(int64_t)>& on_sent) {
  std::ifstream shard(file, std::ios::binary);
  for (int64_t left = size; left > 0;) {
    const int64_t count = std::min(left, kChunkBytes);
    v1::UploadDatasetRequest message;
    std::string* chunk = message.mutable_chunk();
    chunk->resize(static_cast<size_t>(count));
    if (!shard.read(chunk->data(), count)) {
      return absl::DataLossError(absl::StrCat(file.string(), " cannot be read to its end"));
    }
    if (!writer->Write(message)) return false;
    left -= count;
    on_sent(count);
  }
  return true;
}

}  // namespace

absl::StatusOr<v1::Dataset> Client::UploadDataset(const std::string& folder,
                                                  const std::string& name,
                                                  const OnUploaded& on_progress,
                                                  const CallOptions& call) {
  absl::StatusOr<v1::Dataset> dataset = ReadWholeFolder(folder);
  if (!dataset.ok()) return dataset.status();
  int64_t total = 0;
  for (const v1::Shard& shard : dataset->shards()) total += shard.size_bytes();

  grpc::ClientContext context;
  connection_->Introduce(context);
  context.set_deadline(absl::ToChronoTime(
      absl::Now() + call.timeout.value_or(connection_->options.deadlines.upload)));
  const Cancellation::Registration registration(call.cancellation,
                                                [&context] { context.TryCancel(); });
  v1::Dataset committed;
  const auto writer = connection_->datasets->UploadDataset(&context, &committed);

  v1::UploadDatasetRequest first;
  first.mutable_header()->set_name(name);
  *first.mutable_header()->mutable_dataset() = *dataset;
  bool taken = writer->Write(first);
  int64_t sent = 0;
  for (const v1::Shard& shard : dataset->shards()) {
    if (!taken) break;
    const absl::StatusOr<bool> more = SendShard(fs::path(folder) / shard.file(), shard.size_bytes(),
                                                writer.get(), [&](int64_t bytes) {
                                                  sent += bytes;
                                                  if (on_progress) on_progress(sent, total);
                                                });
    if (!more.ok()) {  // what the server has so far must not become a dataset
      context.TryCancel();
      writer->Finish();
      return more.status();
    }
    taken = *more;
  }
  if (taken) writer->WritesDone();
  absl::Status status = ToStatus(writer->Finish());  // also says why the server took no more
  if (!status.ok()) return status;
  return committed;
}

}  // namespace maneuver::client
