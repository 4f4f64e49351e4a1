#include <filesystem>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/client.h"
#include "client/connection.h"
#include "client/file_digest.h"
#include "client/file_download.h"
#include "client/file_upload.h"

namespace maneuver::client {
namespace {

namespace fs = std::filesystem;

absl::StatusOr<v1::ModelFile> DescribeFile(const fs::path& folder, const std::string& name) {
  v1::ModelFile file;
  std::error_code error;
  const auto size = fs::file_size(folder / name, error);
  if (error) {
    return absl::NotFoundError(
        absl::StrCat(folder.string(), " is not a model folder: it has no ", name));
  }
  auto digest = Sha256OfFile((folder / name).string());
  if (!digest.ok()) return digest.status();
  file.set_file(name);
  file.set_size_bytes(static_cast<int64_t>(size));
  file.set_sha256(*std::move(digest));
  return file;
}

}  // namespace

absl::StatusOr<v1::ModelVersion> Client::UploadModelVersion(const std::string& folder,
                                                            const std::string& parent,
                                                            const OnUploaded& on_progress,
                                                            const CallOptions& call) {
  google::protobuf::RepeatedPtrField<v1::ModelFile> announced;
  std::vector<LocalFile> files;
  std::vector<std::string> names = {"model.json", "weights.safetensors"};
  std::error_code error;
  if (fs::exists(fs::path(folder) / "baselines.json", error)) {
    names.insert(names.end(), {"baselines.json", "baselines.safetensors"});
  }
  for (const std::string& name : names) {
    auto file = DescribeFile(folder, name);
    if (!file.ok()) return file.status();
    files.push_back({(fs::path(folder) / name).string(), file->size_bytes()});
    *announced.Add() = *std::move(file);
  }
  v1::ModelVersion committed;
  UploadCalls calls;
  calls.may_be_committed_before = true;
  calls.ask = [&](grpc::ClientContext& context, ArrivedBytes* arrived, bool* is_committed) {
    v1::QueryModelUploadRequest request;
    request.set_parent(parent);
    *request.mutable_files() = announced;
    v1::QueryModelUploadResponse answer;
    const grpc::Status status = connection_->models->QueryModelUpload(&context, request, &answer);
    arrived->Swap(answer.mutable_arrived_bytes());
    *is_committed = answer.has_committed();
    if (answer.has_committed()) committed = std::move(*answer.mutable_committed());
    return status;
  };
  calls.send = [&](grpc::ClientContext& context, const ArrivedBytes& arrived,
                   const UploadCalls::SendChunks& send_chunks) {
    const auto writer = connection_->models->UploadModelVersion(&context, &committed);
    v1::UploadModelVersionRequest first;
    first.mutable_header()->set_parent(parent);
    *first.mutable_header()->mutable_files() = announced;
    *first.mutable_header()->mutable_arrived_bytes() = arrived;
    return SendUpload(*writer, first, send_chunks);
  };
  const absl::Status status = UploadFiles(
      connection_->options, files, calls,
      [this](grpc::ClientContext& context) { connection_->Introduce(context); }, on_progress, call);
  if (!status.ok()) return status;
  return committed;
}

absl::StatusOr<std::string> Client::DownloadModelVersion(const std::string& name,
                                                         const std::string& folder,
                                                         const OnUploaded& on_progress,
                                                         const CallOptions& call) {
  const ReadDownload read = [&](grpc::ClientContext& context, const std::string& resource,
                                const ArrivedBytes& arrived, const TakeDownload& take) {
    v1::DownloadModelVersionRequest request;
    request.set_name(resource);
    *request.mutable_arrived_bytes() = arrived;
    const auto reader = connection_->models->DownloadModelVersion(&context, request);
    return ReadToEnd(context, *reader, take,
                     [](const auto& header) { return header.model_version(); });
  };
  return DownloadFiles(
      connection_->options, {.name = name, .folder = folder, .noun = "a model", .most_files = 16},
      read, [this](grpc::ClientContext& context) { connection_->Introduce(context); }, on_progress,
      call);
}

}  // namespace maneuver::client
