// Receives files in one server-streaming call after another, until all are here. Private to the
// library.

#ifndef MANEUVER_CLIENT_FILE_DOWNLOAD_H_
#define MANEUVER_CLIENT_FILE_DOWNLOAD_H_

#include <google/protobuf/repeated_field.h>
#include <grpcpp/grpcpp.h>

#include <functional>
#include <string>

#include "absl/status/statusor.h"
#include "client/client_options.h"
#include "client/file_upload.h"
#include "maneuver/v1/model_service.pb.h"

namespace maneuver::client {

// What is downloaded, and where to.
struct DownloadTarget {
  std::string name;    // as the caller names it
  std::string folder;  // as in Client::DownloadModelVersion
  std::string noun;    // what the files are together, "a model"
  int most_files;
};

// What the first message of a call says.
struct DownloadHeader {
  std::string resource;  // what is sent
  google::protobuf::RepeatedPtrField<v1::ModelFile> files;
};

// Take the messages of a call, and return whether the call is to continue.
struct TakeDownload {
  std::function<bool(const DownloadHeader& header)> header;
  std::function<bool(const std::string& chunk)> chunk;
};

// Makes one call, which sends `resource` without the bytes that have arrived, and returns how it
// ended. Cancels it when a message is not taken.
using ReadDownload = std::function<grpc::Status(grpc::ClientContext&, const std::string& resource,
                                                const ArrivedBytes& arrived, const TakeDownload&)>;

// Reads one call to its end, as a ReadDownload does.
//   name_of: returns what a header says is sent
template <typename Response, typename NameOf>
grpc::Status ReadToEnd(grpc::ClientContext& context, grpc::ClientReader<Response>& reader,
                       const TakeDownload& take, NameOf name_of) {
  Response message;
  bool goes_on = true;
  while (goes_on && reader.Read(&message)) {
    goes_on = message.has_header()
                  ? take.header({name_of(message.header()), message.header().files()})
                  : take.chunk(message.chunk());
  }
  if (!goes_on) context.TryCancel();
  return reader.Finish();
}

// Downloads files into a folder, as Client::DownloadModelVersion says. Returns the header's
// resource.
//   introduce: adds the caller's identity
absl::StatusOr<std::string> DownloadFiles(
    const ClientOptions& options, const DownloadTarget& target, const ReadDownload& read,
    const std::function<void(grpc::ClientContext&)>& introduce, const OnUploaded& on_progress,
    const CallOptions& call);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_FILE_DOWNLOAD_H_
