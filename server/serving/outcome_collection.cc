#include "server/serving/outcome_collection.h"

#include <cmath>
#include <optional>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "model/data/recording_split.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "server/monitoring/logging.h"

namespace maneuver::serving {
namespace {

namespace fs = std::filesystem;

constexpr char kOutcomeExtension[] = ".outcome";
constexpr size_t kDigestLength = 32;  // hexadecimal digits
constexpr int64_t kBlock = 4096;      // of the disk, bytes

std::string DigestOf(std::string_view bytes) {
  return files::Sha256Hex(bytes).substr(0, kDigestLength);
}

// What a file takes of the disk.
int64_t BytesOnDisk(uint64_t bytes) {
  return (static_cast<int64_t>(bytes) + kBlock - 1) / kBlock * kBlock;
}

struct Name {
  std::string digest;
  std::string event;
  double surprise = 0.0;
};

std::optional<Name> ParseName(std::string text) {
  if (!text.ends_with(kOutcomeExtension)) return std::nullopt;
  text.resize(text.size() - std::string_view(kOutcomeExtension).size());
  const std::vector<std::string> parts = absl::StrSplit(text, ',');
  Name name;
  if (parts.size() < 2 || parts.size() > 3 || parts.front().size() != kDigestLength ||
      !absl::SimpleAtod(parts.back(), &name.surprise) || !std::isfinite(name.surprise)) {
    return std::nullopt;
  }
  name.digest = parts.front();
  if (parts.size() == 3) name.event = parts[1];
  return name;
}

}  // namespace

std::string EventOf(const std::string& scenario_id, double prediction_time) {
  constexpr double kSeconds = 5.0;
  constexpr size_t kDigits = 16;
  const std::string_view drive = data::WithoutPart(scenario_id);
  if (drive.empty()) return "";
  return DigestOf(absl::StrFormat("%s %.0f", drive, std::floor(prediction_time / kSeconds)))
      .substr(0, kDigits);
}

OutcomeCollection::Metrics::Metrics(monitoring::MetricRegistry& registry)
    : surprising(registry.AddGauge("maneuver_outcome_collected_recordings",
                                   "Outcomes that are kept on disk for a dataset: the most "
                                   "surprising ones, and a sample of the others.",
                                   {{"part", "surprising"}})),
      sampled(registry.AddGauge("maneuver_outcome_collected_recordings",
                                "Outcomes that are kept on disk for a dataset: the most "
                                "surprising ones, and a sample of the others.",
                                {{"part", "sample"}})),
      bytes(registry.AddGauge("maneuver_outcome_collected_bytes",
                              "Disk space of the outcomes that are kept for a dataset.")),
      limit(registry.AddGauge("maneuver_outcome_collected_limit_bytes",
                              "Most disk space of the outcomes that are kept for a dataset.")) {}

OutcomeCollection::OutcomeCollection(fs::path folder, int64_t max_bytes,
                                     monitoring::MetricRegistry& metrics)
    : folder_(std::move(folder)), max_bytes_(max_bytes), metrics_(metrics) {
  metrics_.limit.Set(static_cast<double>(max_bytes));
}

absl::StatusOr<std::unique_ptr<OutcomeCollection>> OutcomeCollection::Open(
    fs::path folder, int64_t max_bytes, monitoring::MetricRegistry& metrics) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return files::ErrnoStatus(error.value(), "create", folder);
  std::unique_ptr<OutcomeCollection> collection(
      new OutcomeCollection(std::move(folder), max_bytes, metrics));
  const absl::Status status = collection->ReadFolder();
  if (!status.ok()) return status;
  return collection;
}

absl::Status OutcomeCollection::ReadFolder() {
  if (absl::Status status = files::RemoveTemporaries(folder_); !status.ok()) return status;
  const MutexLock lock(mutex_);
  std::error_code error;
  fs::directory_iterator entry(folder_, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const auto name = ParseName(entry->path().filename().string());
    if (!name || kept_.contains(name->digest)) continue;
    std::error_code ignored;
    Insert(name->digest, {.surprise = name->surprise,
                          .bytes = BytesOnDisk(fs::file_size(entry->path(), ignored)),
                          .event = name->event});
  }
  if (error) return files::ErrnoStatus(error.value(), "read", folder_);
  const std::vector<std::string> excess = Excess();
  const absl::Status status = RemoveFiles(excess);
  Show();
  return status;
}

absl::Status OutcomeCollection::Add(const std::vector<CollectedOutcome>& outcomes) {
  const MutexLock lock(mutex_);
  absl::Status status;
  for (const CollectedOutcome& outcome : outcomes) {
    status = AddOne(outcome);
    if (!status.ok()) break;
  }
  Show();
  return status;
}

absl::Status OutcomeCollection::AddOne(const CollectedOutcome& outcome) {
  const std::string bytes = outcome.recording.SerializeAsString();
  const std::string digest = DigestOf(bytes);
  const Kept added = {.surprise = std::round(1000.0 * outcome.surprise) / 1000.0,
                      .bytes = BytesOnDisk(bytes.size()),
                      .event = outcome.event};
  if (kept_.contains(digest) || added.bytes > max_bytes_ / 4) return absl::OkStatus();
  Insert(digest, added);
  std::vector<std::string> excess = Excess();
  if (std::erase(excess, digest) > 0) {
    Erase(digest);
  } else {
    // The new one first: a crash in between leaves too much rather than too little.
    absl::Status status = files::WriteFileAtomically(FileOf(digest, added), bytes);
    if (!status.ok()) {
      Erase(digest);
      return status;  // what is above the bound goes with the next outcome
    }
  }
  return RemoveFiles(excess);
}

void OutcomeCollection::Insert(const std::string& digest, const Kept& kept) {
  Kept& inserted = kept_[digest] = kept;
  inserted.is_surprising = true;
  surprising_.emplace(kept.surprise, digest);
  surprising_bytes_ += kept.bytes;
  if (!kept.event.empty()) {
    std::string& most = events_.try_emplace(kept.event, digest).first->second;
    if (most != digest) {
      const bool more = std::pair(kept.surprise, digest) > std::pair(kept_[most].surprise, most);
      const std::string less = more ? std::exchange(most, digest) : digest;
      MoveToSample(less);
    }
  }
  // The least surprising ones make room, and compete for a place in the sample.
  while (surprising_bytes_ > max_bytes_ / 2) MoveToSample(surprising_.begin()->second);
}

void OutcomeCollection::MoveToSample(std::string digest) {
  Kept& kept = kept_[digest];
  RemoveSurprising(digest, kept);
  kept.is_surprising = false;
  sampled_.insert(std::move(digest));
  sampled_bytes_ += kept.bytes;
}

void OutcomeCollection::RemoveSurprising(const std::string& digest, const Kept& kept) {
  const auto event = events_.find(kept.event);
  if (event != events_.end() && event->second == digest) events_.erase(event);
  surprising_.erase({kept.surprise, digest});
  surprising_bytes_ -= kept.bytes;
}

void OutcomeCollection::Erase(const std::string& digest) {
  const auto found = kept_.find(digest);
  if (found == kept_.end()) return;
  const Kept& kept = found->second;
  if (kept.is_surprising) {
    RemoveSurprising(digest, kept);
  } else {
    sampled_.erase(digest);
    sampled_bytes_ -= kept.bytes;
  }
  kept_.erase(found);
}

std::vector<std::string> OutcomeCollection::Excess() {
  std::vector<std::string> excess;
  int64_t bytes = sampled_bytes_;
  for (auto largest = sampled_.rbegin(); bytes > max_bytes_ - surprising_bytes_; ++largest) {
    excess.push_back(*largest);
    bytes -= kept_[*largest].bytes;
  }
  return excess;
}

absl::Status OutcomeCollection::RemoveFiles(const std::vector<std::string>& digests) {
  for (const std::string& digest : digests) {
    const fs::path file = FileOf(digest, kept_[digest]);
    std::error_code error;
    fs::remove(file, error);
    if (error) return files::ErrnoStatus(error.value(), "remove", file);
    Erase(digest);
  }
  return absl::OkStatus();
}

absl::StatusOr<OutcomeCollection::Written> OutcomeCollection::Write(
    data::DatasetWriter& writer) const {
  std::map<std::string, Kept> kept;
  {
    const MutexLock lock(mutex_);
    kept = kept_;
  }
  Written written;
  for (const auto& [digest, entry] : kept) {
    const absl::StatusOr<std::string> bytes = files::ReadFile(FileOf(digest, entry));
    if (absl::IsNotFound(bytes.status())) continue;  // it made room meanwhile
    if (!bytes.ok()) return bytes.status();
    v1::Scenario recording;
    absl::Status status = absl::DataLossError("its SHA-256 is another one");
    if (DigestOf(*bytes) == digest && recording.ParseFromString(*bytes)) {
      status = writer.Add(recording);
    }
    if (absl::IsDataLoss(status) || absl::IsInvalidArgument(status)) {
      monitoring::Log(monitoring::LogLevel::kWarning, "outcome left out of the dataset",
                      {{"file", digest}, {"reason", std::string(status.message())}});
      continue;
    }
    if (!status.ok()) return status;
    written.digests.push_back(digest);
    ++(entry.is_surprising ? written.surprising : written.sampled);
  }
  return written;
}

absl::Status OutcomeCollection::Forget(const Written& written) {
  const MutexLock lock(mutex_);
  std::vector<std::string> left;
  for (const std::string& digest : written.digests) {
    if (kept_.contains(digest)) left.push_back(digest);
  }
  const absl::Status status = RemoveFiles(left);
  Show();
  return status;
}

int64_t OutcomeCollection::bytes() const {
  const MutexLock lock(mutex_);
  return surprising_bytes_ + sampled_bytes_;
}

void OutcomeCollection::Show() {
  metrics_.surprising.Set(static_cast<double>(surprising_.size()));
  metrics_.sampled.Set(static_cast<double>(sampled_.size()));
  metrics_.bytes.Set(static_cast<double>(surprising_bytes_ + sampled_bytes_));
}

fs::path OutcomeCollection::FileOf(const std::string& digest, const Kept& kept) const {
  const std::string event = kept.event.empty() ? "" : absl::StrCat(kept.event, ",");
  return folder_ / absl::StrFormat("%s,%s%.3f%s", digest, event, kept.surprise, kOutcomeExtension);
}

}  // namespace maneuver::serving
