#include "model/data/dataset_manifest.h"

#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <set>

#include "absl/strings/str_cat.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/files/sealed_json.h"

namespace maneuver::data {
namespace {

constexpr size_t kMaxFileName = 100;
constexpr int kMaxShards = 10'000;
constexpr size_t kMaxViolations = 16;

bool IsLowerAlnum(char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); }

// Accepts [a-z0-9][a-z0-9._-]*, at most 100 characters.
bool IsSafeFileName(std::string_view name) {
  return !name.empty() && name.size() <= kMaxFileName && IsLowerAlnum(name.front()) &&
         std::all_of(name.begin(), name.end(),
                     [](char c) { return IsLowerAlnum(c) || c == '.' || c == '_' || c == '-'; });
}

class Violations {
 public:
  void Add(std::string field, std::string description) {
    if (found_.size() < kMaxViolations) {
      found_.push_back({std::move(field), std::move(description)});
    } else {
      ++found_.back().others;
    }
  }
  std::vector<scene::FieldViolation> Take() { return std::move(found_); }

 private:
  std::vector<scene::FieldViolation> found_;
};

void CheckShard(const v1::Shard& shard, const std::string& field, std::set<std::string>* names,
                Violations* violations) {
  if (!IsSafeFileName(shard.file()) || shard.file() == kManifestFile) {
    violations->Add(field + ".file",
                    "must match [a-z0-9][a-z0-9._-]*, have at most 100 characters and not be "
                    "dataset.json");
  } else if (!names->insert(shard.file()).second) {
    violations->Add(field + ".file", "names a file that an earlier shard names");
  }
  if (shard.content() != v1::SHARD_CONTENT_SCENARIOS &&
      shard.content() != v1::SHARD_CONTENT_ANNOTATIONS) {
    violations->Add(field + ".content",
                    "must be SHARD_CONTENT_SCENARIOS or SHARD_CONTENT_ANNOTATIONS");
  }
  if (shard.size_bytes() < 0) violations->Add(field + ".size_bytes", "must not be negative");
  if (shard.records() < 0) violations->Add(field + ".records", "must not be negative");
  if (!files::IsSha256Hex(shard.sha256())) {
    violations->Add(field + ".sha256", "must be 64 lower-case hexadecimal digits");
  }
}

}  // namespace

std::vector<scene::FieldViolation> ValidateDatasetManifest(const v1::Dataset& manifest) {
  Violations violations;
  if (manifest.format_version() != kDatasetFormatVersion) {
    violations.Add("format_version",
                   absl::StrCat("must be ", kDatasetFormatVersion, ", the only one there is"));
  }
  if (manifest.origin().size() > kMaxOrigin) {
    violations.Add("origin", absl::StrCat("must have at most ", kMaxOrigin, " bytes"));
  }
  if (!(manifest.duration_seconds() >= 0.0 && manifest.duration_seconds() <= 1e12)) {
    violations.Add("duration_seconds", "must be a number that is not negative");
  }
  if (manifest.shards_size() > kMaxShards) {
    violations.Add("shards", absl::StrCat("must be at most ", kMaxShards));
    return violations.Take();
  }
  std::set<std::string> names;
  // Unsigned, so that absurd counts wrap around instead of overflowing.
  uint64_t scenarios = 0;
  for (int i = 0; i < manifest.shards_size(); ++i) {
    const v1::Shard& shard = manifest.shards(i);
    CheckShard(shard, absl::StrCat("shards[", i, "]"), &names, &violations);
    if (shard.content() == v1::SHARD_CONTENT_SCENARIOS) {
      scenarios += static_cast<uint64_t>(shard.records());
    }
  }
  if (scenarios == 0) {
    violations.Add("shards", "must hold at least one scenario");
  } else if (static_cast<uint64_t>(manifest.recordings()) != scenarios) {
    violations.Add("recordings", absl::StrCat("is ", manifest.recordings(), " but the shards hold ",
                                              scenarios, " scenarios"));
  }
  return violations.Take();
}

absl::StatusOr<v1::Dataset> ParseDatasetManifest(const std::string& json) {
  v1::Dataset manifest;
  google::protobuf::util::JsonParseOptions options;
  options.ignore_unknown_fields = true;
  const auto status = google::protobuf::util::JsonStringToMessage(json, &manifest, options);
  if (!status.ok()) {
    return absl::DataLossError(
        absl::StrCat(kManifestFile, " is not the JSON of a dataset: ",
                     absl::string_view(status.message().data(), status.message().size())));
  }
  return manifest;
}

std::string PrintDatasetManifest(const v1::Dataset& manifest) {
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.preserve_proto_field_names = true;
  std::string json;
  // Fails only for values that a Dataset cannot hold (Any, invalid timestamps).
  (void)google::protobuf::util::MessageToJsonString(manifest, &json, options);
  return json;
}

absl::StatusOr<v1::Dataset> LoadDatasetManifest(const std::filesystem::path& folder) {
  const auto json = files::ReadFile(folder / kManifestFile);
  if (!json.ok()) return json.status();
  const auto unsealed = files::Unseal(*json);
  if (!unsealed.ok()) {
    return absl::DataLossError(
        absl::StrCat(kManifestFile, " ", unsealed.status().message(),
                     "; if you changed it on purpose, remove its line content_sha256"));
  }
  auto manifest = ParseDatasetManifest(*unsealed);
  if (!manifest.ok()) return manifest.status();
  const auto violations = ValidateDatasetManifest(*manifest);
  if (!violations.empty()) {
    return absl::DataLossError(absl::StrCat(kManifestFile, ": ", violations.front().field, " ",
                                            violations.front().description));
  }
  return manifest;
}

absl::Status WriteDatasetManifest(const std::filesystem::path& folder,
                                  const v1::Dataset& manifest) {
  return files::WriteFileAtomically(folder / kManifestFile,
                                    files::Seal(PrintDatasetManifest(manifest) + "\n"));
}

std::string ContentSha256(const v1::Dataset& manifest) {
  std::string digests;
  for (const v1::Shard& shard : manifest.shards()) absl::StrAppend(&digests, shard.sha256(), "\n");
  return files::Sha256Hex(digests);
}

}  // namespace maneuver::data
