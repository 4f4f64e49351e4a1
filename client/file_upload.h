// An upload of files that goes on where it broke off: what UploadDataset and UploadModelVersion
// share. Private to the library.

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
  // What the server has committed before this upload is as good as what it would commit.
  bool may_be_committed_before = false;
  // Asks what has arrived. Sets *arrived; and *committed, if there is already what the files are to
  // become: the caller then has it.
  std::function<grpc::Status(grpc::ClientContext& context, ArrivedBytes* arrived, bool* committed)>
      ask;
  // Sends a header, then the chunks that `send_chunks` makes. `send_chunks` takes a function that
  // writes a chunk, and says whether all of them were written: the stream is to be half-closed.
  using WriteChunk = std::function<bool(std::string chunk)>;
  using SendChunks = std::function<bool(const WriteChunk& write)>;
  std::function<grpc::Status(grpc::ClientContext& context, const ArrivedBytes& arrived,
                             const SendChunks& send_chunks)>
      send;
};

// Asks, sends, and begins anew where the connection breaks, until the server has committed.
// DATA_LOSS if a file cannot be read to its end.
absl::Status UploadFiles(const ClientOptions& options, const std::vector<LocalFile>& files,
                         const UploadCalls& calls,
                         const std::function<void(grpc::ClientContext&)>& introduce,
                         const Client::OnUploaded& on_progress, const CallOptions& call);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_FILE_UPLOAD_H_
