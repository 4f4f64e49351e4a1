#include "model/learning/checkpoint.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <string>
#include <system_error>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "model/data/tfrecord.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"

namespace maneuver::learning {
namespace {

namespace fs = std::filesystem;

constexpr char kPrefix[] = "checkpoint-";

// Numbers of the checkpoints in a folder, ascending.
std::vector<int64_t> Numbers(const fs::path& folder) {
  std::vector<int64_t> numbers;
  const auto entries = files::ListFolder(folder);
  if (!entries.ok()) return numbers;
  for (const fs::path& entry : *entries) {
    const std::string name = entry.filename().string();
    if (name.compare(0, std::strlen(kPrefix), kPrefix) != 0) continue;
    const int64_t number = std::atoll(name.c_str() + std::strlen(kPrefix));
    if (number > 0) numbers.push_back(number);
  }
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

fs::path FileOf(const fs::path& folder, int64_t number) {
  return folder / absl::StrFormat("%s%06d", kPrefix, number);
}

}  // namespace

absl::StatusOr<CheckpointFolder> CheckpointFolder::Open(const fs::path& folder,
                                                        const CheckpointPolicy& policy) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return files::ErrnoStatus(error.value(), "create", folder);
  if (absl::Status status = files::RemoveTemporaries(folder); !status.ok()) return status;
  return CheckpointFolder(folder, policy);
}

CheckpointFolder::CheckpointFolder(fs::path folder, const CheckpointPolicy& policy)
    : folder_(std::move(folder)), policy_(policy), last_(std::chrono::steady_clock::now()) {
  const std::vector<int64_t> numbers = Numbers(folder_);
  if (!numbers.empty()) next_ = numbers.back() + 1;
}

std::optional<Checkpoint> CheckpointFolder::ReadLatest() const {
  std::vector<int64_t> numbers = Numbers(folder_);
  for (; !numbers.empty(); numbers.pop_back()) {
    // A checksum, then the message.
    const absl::StatusOr<std::string> content = files::ReadFile(FileOf(folder_, numbers.back()));
    uint32_t checksum = 0;
    if (!content.ok() || content->size() < sizeof(checksum)) continue;
    std::memcpy(&checksum, content->data(), sizeof(checksum));
    const std::string_view message = std::string_view(*content).substr(sizeof(checksum));
    Checkpoint checkpoint;
    if (data::MaskedCrc32c(message) == checksum &&
        checkpoint.ParseFromArray(message.data(), static_cast<int>(message.size()))) {
      return checkpoint;
    }
  }
  return std::nullopt;
}

bool CheckpointFolder::IsDue() const {
  return (policy_.steps > 0 && steps_ >= policy_.steps) ||
         std::chrono::steady_clock::now() - last_ >= policy_.interval;
}

absl::Status CheckpointFolder::Write(const Checkpoint& checkpoint) {
  // Beyond that, protobuf writes nothing at all, and says so only in its log.
  if (checkpoint.ByteSizeLong() > std::numeric_limits<int>::max()) {
    return absl::ResourceExhaustedError(
        "a checkpoint of this model would be larger than 2 GiB: choose a smaller settings.model");
  }
  const std::string message = checkpoint.SerializeAsString();
  const uint32_t checksum = data::MaskedCrc32c(message);
  std::string content(sizeof(checksum), '\0');
  std::memcpy(content.data(), &checksum, sizeof(checksum));
  content += message;
  absl::Status status = files::WriteFileAtomically(FileOf(folder_, next_), content);
  if (!status.ok()) return status;
  ++next_;
  last_ = std::chrono::steady_clock::now();
  steps_ = 1;  // the step that this checkpoint precedes
  const std::vector<int64_t> numbers = Numbers(folder_);
  const size_t kept = static_cast<size_t>(std::max(1, policy_.kept));
  for (size_t i = 0; i + kept < numbers.size(); ++i) {
    std::error_code ignored;
    fs::remove(FileOf(folder_, numbers[i]), ignored);
  }
  return absl::OkStatus();
}

}  // namespace maneuver::learning
