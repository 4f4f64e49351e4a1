#include "model/data/dataset_folder.h"

#include <algorithm>
#include <unordered_set>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_manifest.h"
#include "model/data/recording_index.h"
#include "model/data/shard_records.h"
#include "model/data/tfrecord.h"
#include "model/files/digest.h"
#include "model/machine/parallel.h"
#include "model/machine/usable_cores.h"
#include "model/scene/scenario_validation.h"

namespace maneuver::data {
namespace {

template <typename Message>
absl::Status ForEachMessage(const std::filesystem::path& folder, v1::ShardContent content,
                            OnDamage on_damage, const std::function<bool(Message&&)>& visit,
                            int64_t* skipped) {
  int64_t passed_over = 0;
  const absl::Status status = ForEachPayload(
      folder, content, on_damage,
      [&visit](const v1::Shard& shard, uint64_t offset, std::string&& payload, bool* more) {
        Message message;
        if (!message.ParseFromString(payload)) {
          return NotAMessage(shard, offset, absl::StrCat("a ", Message::descriptor()->name()));
        }
        *more = visit(std::move(message));
        return absl::OkStatus();
      },
      &passed_over);
  if (skipped != nullptr) *skipped += passed_over;
  return status;
}

// Checks a whole shard. Collects scenario ids in *ids; annotations must name one of them.
absl::Status VerifyShard(const std::filesystem::path& folder, const v1::Shard& shard,
                         std::unordered_set<std::string>* ids) {
  const auto sha256 = files::Sha256OfFile(folder / shard.file());
  if (!sha256.ok()) return sha256.status();
  if (*sha256 != shard.sha256()) {
    return absl::DataLossError(absl::StrCat("shard ", shard.file(), " has SHA-256 ", *sha256, "; ",
                                            kManifestFile, " says ", shard.sha256()));
  }
  const VisitPayload visit = [&shard, ids](const v1::Shard&, uint64_t offset, std::string&& payload,
                                           bool*) -> absl::Status {
    if (shard.content() == v1::SHARD_CONTENT_ANNOTATIONS) {
      v1::ManeuverAnnotation annotation;
      if (!annotation.ParseFromString(payload)) {
        return NotAMessage(shard, offset, "a ManeuverAnnotation");
      }
      if (ids->contains(annotation.scenario_id())) return absl::OkStatus();
      return NotAMessage(shard, offset, "an annotation of a scenario of this dataset");
    }
    v1::Scenario scenario;
    if (!scenario.ParseFromString(payload)) return NotAMessage(shard, offset, "a Scenario");
    const std::string& id = scenario.scenario_id();
    if (id.empty()) return NotAMessage(shard, offset, "a scenario with an id");
    const auto violations = scene::ValidateScenario(scenario, {});
    if (!violations.empty()) {
      return absl::DataLossError(absl::StrCat(shard.file(), ", record at byte ", offset,
                                              " (scenario ", id, "): ", violations.front().field,
                                              " ", violations.front().description));
    }
    if (ids->insert(id).second) return absl::OkStatus();
    return absl::DataLossError(absl::StrCat(shard.file(), ", record at byte ", offset,
                                            ": scenario ", id, " is in the dataset twice"));
  };
  return ForEachPayloadOfShard(folder, shard, visit);
}

}  // namespace

absl::Status VerifyDatasetFolder(const std::filesystem::path& folder) {
  const auto manifest = ReadDatasetManifest(folder);
  if (!manifest.ok()) return manifest.status();
  std::unordered_set<std::string> ids;
  for (const auto content : {v1::SHARD_CONTENT_SCENARIOS, v1::SHARD_CONTENT_ANNOTATIONS}) {
    for (const v1::Shard& shard : manifest->shards()) {
      if (shard.content() != content) continue;
      if (absl::Status status = VerifyShard(folder, shard, &ids); !status.ok()) return status;
    }
  }
  return absl::OkStatus();
}

absl::Status ForEachScenario(const std::filesystem::path& folder, OnDamage on_damage,
                             const std::function<bool(v1::Scenario&&)>& visit, int64_t* skipped) {
  return ForEachMessage<v1::Scenario>(folder, v1::SHARD_CONTENT_SCENARIOS, on_damage, visit,
                                      skipped);
}

absl::Status ForEachAnnotation(const std::filesystem::path& folder, OnDamage on_damage,
                               const std::function<bool(v1::ManeuverAnnotation&&)>& visit) {
  return ForEachMessage<v1::ManeuverAnnotation>(folder, v1::SHARD_CONTENT_ANNOTATIONS, on_damage,
                                                visit, nullptr);
}

absl::StatusOr<std::vector<v1::Scenario>> ReadRecordings(const std::filesystem::path& folder,
                                                         int threads) {
  std::vector<std::string> payloads;
  int64_t skipped = 0;
  const absl::Status status = ForEachPayload(
      folder, v1::SHARD_CONTENT_SCENARIOS, OnDamage::kStop,
      [&payloads](const v1::Shard&, uint64_t, std::string&& payload, bool*) {
        payloads.push_back(std::move(payload));
        return absl::OkStatus();
      },
      &skipped);
  if (!status.ok()) return status;

  // Reading is limited by the disk and by the CRC on one core; parsing takes most of the time.
  std::vector<v1::Scenario> recordings(payloads.size());
  const absl::Status parsed = machine::ForEachOnThreads(
      payloads.size(), threads > 0 ? threads : machine::UsableCores(), [&](size_t i) {
        if (!recordings[i].ParseFromString(payloads[i])) {
          return absl::DataLossError(absl::StrCat("recording ", i, " does not parse"));
        }
        std::string().swap(payloads[i]);
        return absl::OkStatus();
      });
  if (!parsed.ok()) return parsed;
  return recordings;
}

absl::StatusOr<v1::Scenario> ReadScenario(const std::filesystem::path& folder,
                                          const std::string& scenario_id) {
  const absl::StatusOr<RecordingIndex> index = RecordingIndex::Open(folder);
  if (!index.ok()) return index.status();
  const int64_t found = index->Find(scenario_id);
  if (found < 0) {
    return absl::NotFoundError(absl::StrCat("the dataset has no scenario ", scenario_id));
  }
  return index->Read(static_cast<size_t>(found));
}

}  // namespace maneuver::data
