#include "client/client.h"
#include "client/connection.h"
#include "client/file_download.h"

namespace maneuver::client {

absl::StatusOr<std::string> Client::DownloadTags(const std::string& name, const std::string& folder,
                                                 const OnUploaded& on_progress,
                                                 const CallOptions& call) {
  constexpr int kMostFiles = 1'000'000;
  const ReadDownload read = [&](grpc::ClientContext& context, const std::string& resource,
                                const ArrivedBytes& arrived, const TakeDownload& take) {
    v1::DownloadTagsRequest request;
    request.set_name(resource);
    *request.mutable_arrived_bytes() = arrived;
    const auto reader = connection_->tags->DownloadTags(&context, request);
    return ReadToEnd(context, *reader, take, [](const auto& header) { return header.name(); });
  };
  return DownloadFiles(
      connection_->options,
      {.name = name, .folder = folder, .noun = "tags", .most_files = kMostFiles}, read,
      [this](grpc::ClientContext& context) { connection_->Introduce(context); }, on_progress, call);
}

}  // namespace maneuver::client
