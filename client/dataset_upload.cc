#include <google/protobuf/util/json_util.h>

#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "client/client.h"
#include "client/connection.h"
#include "client/file_digest.h"
#include "client/file_upload.h"

namespace maneuver::client {
namespace {

namespace fs = std::filesystem;

// How dataset.json begins if it carries the SHA-256 of the rest.
constexpr absl::string_view kSeal = "{\n \"content_sha256\": \"";
constexpr size_t kDigits = 64;
constexpr absl::string_view kSealEnd = "\",";

// Returns the JSON without its digest, which it checks; nothing if the file is damaged.
std::optional<std::string> Unsealed(const std::string& text) {
  if (!absl::StartsWith(text, kSeal)) return text;
  const size_t rest = kSeal.size() + kDigits + kSealEnd.size();
  if (text.size() < rest) return std::nullopt;
  std::string json = "{" + text.substr(rest);
  if (Sha256Of(json) != text.substr(kSeal.size(), kDigits)) return std::nullopt;
  return json;
}

// dataset.json of a folder whose shards are all there with the sizes that it states.
absl::StatusOr<v1::Dataset> ReadWholeFolder(const fs::path& folder) {
  std::ifstream file(folder / "dataset.json", std::ios::binary);
  if (!file) {
    return absl::NotFoundError(
        absl::StrCat(folder.string(), " is not a dataset folder: it has no dataset.json"));
  }
  std::ostringstream text;
  text << file.rdbuf();
  const std::optional<std::string> json = Unsealed(text.str());
  if (!json) {
    return absl::DataLossError(
        absl::StrCat((folder / "dataset.json").string(),
                     " is damaged: its SHA-256 is not what it says; if you changed it on purpose, "
                     "remove its line content_sha256"));
  }
  v1::Dataset dataset;
  if (!google::protobuf::util::JsonStringToMessage(*json, &dataset).ok()) {
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

}  // namespace

absl::StatusOr<v1::Dataset> Client::UploadDataset(const std::string& folder,
                                                  const std::string& name,
                                                  const OnUploaded& on_progress,
                                                  const CallOptions& call) {
  const absl::StatusOr<v1::Dataset> dataset = ReadWholeFolder(folder);
  if (!dataset.ok()) return dataset.status();
  std::vector<LocalFile> files;
  for (const v1::Shard& shard : dataset->shards()) {
    files.push_back({(fs::path(folder) / shard.file()).string(), shard.size_bytes()});
  }
  v1::Dataset committed;
  UploadCalls calls;
  calls.ask = [&](grpc::ClientContext& context, ArrivedBytes* arrived, bool* is_committed) {
    v1::QueryUploadRequest request;
    request.set_name(name);
    *request.mutable_dataset() = *dataset;
    v1::QueryUploadResponse answer;
    const grpc::Status status = connection_->datasets->QueryUpload(&context, request, &answer);
    arrived->Swap(answer.mutable_arrived_bytes());
    *is_committed = answer.has_committed();
    if (answer.has_committed()) committed = std::move(*answer.mutable_committed());
    return status;
  };
  calls.send = [&](grpc::ClientContext& context, const ArrivedBytes& arrived,
                   const UploadCalls::SendChunks& send_chunks) {
    const auto writer = connection_->datasets->UploadDataset(&context, &committed);
    v1::UploadDatasetRequest first;
    first.mutable_header()->set_name(name);
    *first.mutable_header()->mutable_dataset() = *dataset;
    *first.mutable_header()->mutable_arrived_bytes() = arrived;
    return SendUpload(*writer, first, send_chunks);
  };
  const absl::Status status = UploadFiles(
      connection_->options, files, calls,
      [this](grpc::ClientContext& context) { connection_->Introduce(context); }, on_progress, call);
  if (!status.ok()) return status;
  return committed;
}

}  // namespace maneuver::client
