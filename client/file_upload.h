// Uploads files and continues where an interrupted upload stopped. UploadDataset and
// UploadModelVersion share it. Private to the library.

#ifndef MANEUVER_CLIENT_FILE_UPLOAD_H_
#define MANEUVER_CLIENT_FILE_UPLOAD_H_

#include <google/protobuf/repeated_field.h>

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "client/connection.h"

namespace maneuver::client {

struct LocalFile {
  std::string path;
  int64_t size_bytes = 0;
};

using ArrivedBytes = google::protobuf::RepeatedField<int64_t>;  // [files] bytes

// What differs between one kind of upload and another.
struct UploadCalls {
  // Whether the upload is complete if the server already had the same files when it began.
  bool may_be_committed_before = false;
  // Asks the server which bytes have arrived, and sets *arrived. If the server has already
  // committed these files, sets *committed and passes the result on to the caller.
  std::function<grpc::Status(grpc::ClientContext& context, ArrivedBytes* arrived, bool* committed)>
      ask;
  // Sends a header, calls `send_chunks` with a function that writes one chunk, and half-closes the
  // stream if `send_chunks` returns true: it has then written all chunks.
  using WriteChunk = std::function<bool(std::string chunk)>;
  using SendChunks = std::function<bool(const WriteChunk& write)>;
  std::function<grpc::Status(grpc::ClientContext& context, const ArrivedBytes& arrived,
                             const SendChunks& send_chunks)>
      send;
};

// Sends `first`, which has the header, and then the chunks. Returns how the call ended.
template <typename Request>
grpc::Status SendUpload(grpc::ClientWriter<Request>& writer, const Request& first,
                        const UploadCalls::SendChunks& send_chunks) {
  const auto write = [&writer](std::string chunk) {
    Request message;
    message.set_chunk(std::move(chunk));
    return writer.Write(message);
  };
  if (writer.Write(first) && send_chunks(write)) writer.WritesDone();
  return writer.Finish();  // also says why it took no more
}

// Asks, sends, and repeats this after a broken connection, until the server has committed, or
// nothing more has arrived for ClientOptions::upload_patience. If the server finds that what had
// arrived before is wrong, asks and sends once more. DATA_LOSS if a file cannot be read to its end,
// or is wrong all the same; INTERNAL if the server's answer does not fit the files.
//   introduce: adds the caller's identity to the context of each call
absl::Status UploadFiles(const ClientOptions& options, const std::vector<LocalFile>& files,
                         const UploadCalls& calls,
                         const std::function<void(grpc::ClientContext&)>& introduce,
                         const OnUploaded& on_progress, const CallOptions& call);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_FILE_UPLOAD_H_
