// Reads files of a folder for a download.

#ifndef MANEUVER_SERVER_SERVING_FILE_SENDER_H_
#define MANEUVER_SERVER_SERVING_FILE_SENDER_H_

#include <google/protobuf/repeated_field.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/model_service.pb.h"

namespace maneuver::serving {

// Reads files one after the other, each from its first byte to its last. Not thread-safe.
class FileSender {
 public:
  enum class Opening {
    kNow,    // when it is added: if its name is replaced later, the bytes stay those of this file
    kLater,  // when its turn comes, so that many files need few descriptors
  };

  FileSender();
  ~FileSender();

  // Adds a file, with its name and size. The caller sets its SHA-256. Fails if the file cannot be
  // opened: NOT_FOUND if it does not exist.
  absl::Status Add(const std::filesystem::path& folder, const std::string& name, Opening opening);
  v1::ModelFile& file(int index) { return files_[index]; }
  const google::protobuf::RepeatedPtrField<v1::ModelFile>& files() const { return files_; }
  // Returns all bytes of a file that was added with kNow.
  absl::StatusOr<std::string> ReadWhole(int index) const;

  // Skips the first arrived_bytes[i] bytes of each file i. Call before Next. INVALID_ARGUMENT, with
  // the field arrived_bytes, unless it is empty or has for each file a number from 0 to its size.
  absl::Status Skip(const google::protobuf::RepeatedField<int64_t>& arrived_bytes);
  // Returns the next bytes, at most 1 MiB and of one file; empty at the end. DATA_LOSS, naming the
  // file, if it has become shorter.
  absl::StatusOr<std::string> Next();

 private:
  struct OpenFile;

  google::protobuf::RepeatedPtrField<v1::ModelFile> files_;
  std::vector<std::unique_ptr<OpenFile>> open_;  // as files_
  int next_ = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_FILE_SENDER_H_
