// Uploads files and continues where an interrupted upload stopped. UploadDataset and
// UploadModelVersion share it. Private to the library.

#ifndef MANEUVER_CLIENT_FILE_UPLOAD_H_
#define MANEUVER_CLIENT_FILE_UPLOAD_H_

#include <google/protobuf/repeated_field.h>

#include <cstdint>
#include <functional>
#include <string>
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
  // If the server committed equal files before this upload began, whether that completes this
  // upload.
  bool may_be_committed_before = false;
  // Asks the server which bytes have arrived, and sets *arrived. If the server has already
  // committed these files, sets *committed and passes the result on to the caller.
  std::function<grpc::Status(grpc::ClientContext& context, ArrivedBytes* arrived, bool* committed)>
      ask;
  // Sends a header, then the chunks that `send_chunks` makes. `send_chunks` is given a function
  // that writes one chunk, and returns whether all chunks were written; the stream is then
  // half-closed.
  using WriteChunk = std::function<bool(std::string chunk)>;
  using SendChunks = std::function<bool(const WriteChunk& write)>;
  std::function<grpc::Status(grpc::ClientContext& context, const ArrivedBytes& arrived,
                             const SendChunks& send_chunks)>
      send;
};

// Asks, sends, and repeats this after a broken connection, until the server has committed.
// DATA_LOSS if a file cannot be read to its end.
absl::Status UploadFiles(const ClientOptions& options, const std::vector<LocalFile>& files,
                         const UploadCalls& calls,
                         const std::function<void(grpc::ClientContext&)>& introduce,
                         const OnUploaded& on_progress, const CallOptions& call);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_FILE_UPLOAD_H_
