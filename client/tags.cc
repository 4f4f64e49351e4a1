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
    v1::DownloadTagsResponse message;
    bool goes_on = true;
    while (goes_on && reader->Read(&message)) {
      goes_on = message.has_header()
                    ? take.header({message.header().name(), message.header().files()})
                    : take.chunk(message.chunk());
    }
    if (!goes_on) context.TryCancel();
    return reader->Finish();
  };
  return DownloadFiles(
      connection_->options,
      {.name = name, .folder = folder, .noun = "tags", .most_files = kMostFiles}, read,
      [this](grpc::ClientContext& context) { connection_->Introduce(context); }, on_progress, call);
}

}  // namespace maneuver::client
