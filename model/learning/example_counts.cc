#include "model/learning/example_counts.h"

#include <cstring>
#include <span>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/data/example_index.h"
#include "model/data/recording_split.h"
#include "model/data/tfrecord.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/learning/example_set.h"
#include "model/machine/parallel.h"

namespace maneuver::learning {
namespace {

namespace fs = std::filesystem;

// To be raised when data::EnumerateExamples finds others than before.
constexpr int kCountsVersion = 1;

// Names the file after all that the counts depend on.
std::string CountsFileName(const v1::Dataset& manifest, const v1::TrainingSettings& settings) {
  v1::ExampleSettings examples = TrainingExampleSettings(settings);
  // These do not choose examples.
  examples.clear_max_examples();
  examples.clear_label_share();
  examples.clear_dataset_weights();
  const std::string digest = files::Sha256Hex(
      absl::StrCat(kCountsVersion, "\n", data::ContentSha256(manifest), "\n",
                   settings.model().SerializeAsString(), "\n", examples.SerializeAsString()));
  return absl::StrCat(".examples-", digest.substr(0, 16));
}

// The file has a masked CRC-32C and then the counts. Returns nothing unless it is whole.
std::vector<int32_t> ReadCounts(const fs::path& file, size_t recordings) {
  const absl::StatusOr<std::string> content = files::ReadFile(file);
  uint32_t crc = 0;
  if (!content.ok() || content->size() != sizeof(crc) + recordings * sizeof(int32_t)) return {};
  const std::string_view counted = std::string_view(*content).substr(sizeof(crc));
  std::memcpy(&crc, content->data(), sizeof(crc));
  if (data::MaskedCrc32c(counted) != crc) return {};
  std::vector<int32_t> counts(recordings);
  std::memcpy(counts.data(), counted.data(), counted.size());
  return counts;
}

void KeepCounts(const fs::path& file, std::span<const int32_t> counts) {
  const std::string_view bytes(reinterpret_cast<const char*>(counts.data()), counts.size_bytes());
  const uint32_t crc = data::MaskedCrc32c(bytes);
  std::string content(sizeof(crc), '\0');
  std::memcpy(content.data(), &crc, sizeof(crc));
  content += bytes;
  // Without a place to keep them, they are counted again the next time.
  (void)files::WriteFileAtomically(file, content);
}

}  // namespace

absl::StatusOr<std::vector<int32_t>> CountExamplesPerRecording(
    const fs::path& folder, const data::RecordingIndex& index, const v1::TrainingSettings& settings,
    int threads, const std::function<bool()>& keep_going) {
  const absl::StatusOr<v1::Dataset> manifest = data::ReadDatasetManifest(folder);
  if (!manifest.ok()) return manifest.status();
  const auto& entries = index.entries();
  const fs::path file = folder / CountsFileName(*manifest, settings);
  std::vector<int32_t> counts = ReadCounts(file, entries.size());
  if (!counts.empty()) return counts;
  counts.assign(entries.size(), kHeldOut);
  const v1::ExampleSettings examples = TrainingExampleSettings(settings);
  const absl::Status status = machine::ForEachOnThreads(entries.size(), threads, [&](size_t i) {
    if (!keep_going()) return absl::CancelledError("stopped while counting the examples");
    if (data::HeldOut(entries[i].scenario_id, examples.validation_share())) {
      return absl::OkStatus();
    }
    const absl::StatusOr<v1::Scenario> recording = index.Read(i);
    if (!recording.ok()) return recording.status();
    counts[i] = static_cast<int32_t>(
        data::EnumerateExamples(*recording, 0, settings.model(), examples).size());
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  KeepCounts(file, counts);
  return counts;
}

}  // namespace maneuver::learning
