// Files that others give us, byte by byte: TFRecord, recordings of Waymo and CommonRoad, weights,
// manifests, indexes. Each is read in full or refused; what was read can be written and read again.

#include <google/protobuf/util/message_differencer.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <set>
#include <string>

#include "absl/status/status.h"
#include "model/artifact/model_cost.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/model_spec.h"
#include "model/artifact/safetensors.h"
#include "model/data/commonroad/commonroad_reader.h"
#include "model/data/dataset_folder.h"
#include "model/data/recording_index.h"
#include "model/data/tfrecord.h"
#include "model/data/waymo/waymo_reader.h"
#include "model/files/sealed_json.h"
#include "model/scene/scenario_validation.h"
#include "shard_index.pb.h"
#include "tests/fuzz/harness.h"

namespace maneuver::fuzz {
namespace {

// An importer may leave an implausible recording to ValidateScenario, but not a broken one.
void ExpectRecording(const absl::StatusOr<v1::Scenario>& scenario) {
  if (!scenario.ok()) {
    Expect(scenario.status().code() == absl::StatusCode::kInvalidArgument,
           scenario.status().ToString());
    Expect(!scenario.status().message().empty(), "a refusal says why");
    return;
  }
  Expect(!scenario->scenario_id().empty(), "a recording has an id");
  Expect(scenario->agents_size() > 0, "a recording has agents");
  std::set<int64_t> ids;
  for (const v1::Agent& agent : scenario->agents()) {
    ids.insert(agent.id());
    for (const v1::AgentState& state : agent.states()) {
      Expect(std::isfinite(state.x()) && std::isfinite(state.y()) && std::isfinite(state.time()) &&
                 std::isfinite(state.heading()),
             "states are finite");
    }
  }
  for (const int64_t target : scenario->target_ids())
    Expect(ids.count(target) > 0, "targets are agents");
  if (!scene::ValidateScenario(*scenario, {}).empty()) return;
  v1::Scenario again;
  Expect(again.ParseFromString(scenario->SerializeAsString()), "a valid recording can be stored");
}

template <typename Message>
bool Same(const Message& a, const Message& b) {
  return a.SerializeAsString() == b.SerializeAsString();
}

constexpr char kPacked[] = "\x1f\x8b";  // how gzip begins

template <typename Number>
std::string LittleEndian(Number number) {
  return {reinterpret_cast<const char*>(&number), sizeof number};
}

// Reads the bytes as TFRecord, in order and each record from its place.
void ReadRecords(std::string_view bytes) {
  const std::filesystem::path file = FileOf(bytes);
  auto reader = data::TfRecordReader::Open(file, {.max_record_bytes = 1 << 16, .allow_gzip = true});
  if (!reader.ok()) return;
  const bool packed = bytes.substr(0, 2) == kPacked;
  std::string payload;
  uint64_t before = 0;
  bool first = true;
  for (;;) {
    const absl::Status status = (*reader)->Next(&payload);
    if (status.code() == absl::StatusCode::kOutOfRange) break;
    if (!status.ok()) {
      Expect(status.code() == absl::StatusCode::kDataLoss, status.ToString());
      if (!(*reader)->can_continue()) break;
    }
    const uint64_t offset = (*reader)->offset();
    Expect(first || offset > before, "offsets increase");
    first = false;
    before = offset;
    if (!status.ok() || packed) continue;
    const auto alone = data::ReadRecordAt(file, offset, payload.size());
    Expect(alone.ok() && *alone == payload, "a record read from its place is the same");
    Expect(!data::ReadRecordAt(file, offset, payload.size() + 1).ok(), "another length is refused");
  }
}

// Returns the records of the bytes, each with the lengths and checksums that it should have, but
// for the last one: its length may be too long.
std::string WithRightChecksums(std::string_view bytes) {
  std::string records;
  while (bytes.size() >= 12) {
    uint64_t length = 0;
    std::memcpy(&length, bytes.data(), sizeof length);
    const std::string header = LittleEndian(length);
    const std::string_view payload = bytes.substr(12, length);
    records += header + LittleEndian(data::MaskedCrc32c(header));
    records += std::string(payload) + LittleEndian(data::MaskedCrc32c(payload));
    bytes.remove_prefix(std::min(bytes.size(), 12 + payload.size() + 4));
  }
  return records + std::string(bytes);
}

// Returns a dataset folder of two recordings, "a" and "b".
const std::filesystem::path& IndexedFolder() {
  static const auto& folder = *new std::filesystem::path([] {
    const auto made = Folder() / "indexed";
    auto writer = data::DatasetWriter::Create(made, "fuzz");
    Expect(writer.ok(), writer.status().ToString());
    for (const char* id : {"a", "b"}) {
      v1::Scenario scenario;
      scenario.set_scenario_id(id);
      v1::Agent* const agent = scenario.add_agents();
      agent->set_id(1);
      agent->set_length(4);
      agent->set_width(2);
      agent->add_states();
      Expect((*writer)->Add(scenario).ok(), "the writer takes a recording");
    }
    Expect((*writer)->Commit().ok(), "the writer commits");
    return made;
  }());
  return folder;
}

}  // namespace

void TfRecord(std::string_view bytes) {
  ReadRecords(bytes);
  if (bytes.substr(0, 2) != kPacked) ReadRecords(WithRightChecksums(bytes));
}

// The bytes are an index, whose checksum is right. One that names no shard is of the shard that is
// there: it is believed, so what it says may be wrong, and no recording is read from a wrong place.
// Any other is never used.
void ShardIndex(std::string_view bytes) {
  static const std::filesystem::path& folder = IndexedFolder();
  static const auto& shard = *new v1::Shard([] {
    const auto manifest = data::ReadDatasetManifest(folder);
    Expect(manifest.ok(), manifest.status().ToString());
    return manifest->shards(0);
  }());
  data::ShardIndex message;
  const bool believed = ParseMessage(bytes, &message) && message.shard_sha256().empty();
  if (believed) message.set_shard_sha256(shard.sha256());
  const std::string content = believed ? message.SerializePartialAsString() : std::string(bytes);
  std::ofstream(folder / ("." + shard.file() + ".index"), std::ios::binary | std::ios::trunc)
      << LittleEndian(data::MaskedCrc32c(content)) << content;
  const auto index = data::RecordingIndex::Open(folder);
  Expect(index.ok(), index.status().ToString());
  Expect(index->entries().size() == 2, "an index has as many entries as its shard has records");
  if (!believed) {
    Expect(index->Find("a") == 0 && index->Find("b") == 1, "recordings are found by their ids");
  }
  for (const size_t i : {0, 1}) {
    const auto recording = index->Read(i);
    if (believed && !recording.ok()) {
      Expect(recording.status().code() == absl::StatusCode::kDataLoss,
             recording.status().ToString());
      continue;
    }
    const bool either = believed && recording->scenario_id() == (i == 0 ? "b" : "a");
    Expect(recording.ok() && (either || recording->scenario_id() == (i == 0 ? "a" : "b")),
           "a recording is read from its place");
  }
}

void Waymo(std::string_view bytes) { ExpectRecording(data::ParseWaymoScenario(bytes)); }

void CommonRoad(std::string_view bytes) { ExpectRecording(data::ParseCommonRoad(bytes)); }

void Safetensors(std::string_view bytes) {
  const auto tensors = artifact::ParseSafetensors(bytes);
  if (!tensors.ok()) {
    Expect(tensors.status().code() == absl::StatusCode::kDataLoss, tensors.status().ToString());
    return;
  }
  size_t values = 0;
  for (const auto& [name, tensor] : *tensors) {
    uint64_t count = 1;
    for (const int64_t size : tensor.shape) {
      Expect(size >= 0, "sizes are not negative");
      count *= static_cast<uint64_t>(size);
    }
    Expect(count == tensor.values.size(), "a tensor has as many values as its shape says");
    values += tensor.values.size();
  }
  Expect(4 * values <= bytes.size(), "values come from the file");
  const std::string written = artifact::SerializeSafetensors(*tensors);
  const auto again = artifact::ParseSafetensors(written);
  Expect(again.ok() && artifact::SerializeSafetensors(*again) == written,
         "tensors are written as they are read");
}

void DatasetJson(std::string_view bytes) {
  const auto manifest = data::ParseDatasetManifest(std::string(bytes));
  if (!manifest.ok()) return;
  const auto again = data::ParseDatasetManifest(data::PrintDatasetManifest(*manifest));
  Expect(again.ok() && Same(*manifest, *again), "a manifest is printed as it was read");
  if (!data::ValidateDatasetManifest(*manifest).empty()) return;
  std::set<std::string> names;
  int64_t bytes_of_shards = 0;
  for (const v1::Shard& shard : manifest->shards()) {
    const std::string& name = shard.file();
    Expect(!name.empty() && name.size() <= 100 && name.front() != '.' &&
               name.find_first_of(std::string_view("/\\\0\n", 4)) == std::string::npos &&
               name != "dataset.json",
           "names of shards are safe");
    Expect(names.insert(name).second, "names of shards differ");
    Expect(shard.size_bytes() >= 0 && shard.sha256().size() == 64, "shards have sizes and digests");
    Expect(!__builtin_add_overflow(bytes_of_shards, shard.size_bytes(), &bytes_of_shards),
           "sizes add up");
  }
  Expect(data::ContentSha256(*manifest).size() == 64, "a dataset has a digest");
}

void ModelJson(std::string_view bytes) {
  static const auto& folder = *new std::filesystem::path([] {
    const auto made = Folder() / "model";
    std::filesystem::create_directories(made);
    return made;
  }());
  const auto inside = files::Unseal(bytes);
  if (inside.ok() && !files::IsSealed(bytes) && bytes.substr(0, 2) == "{\n") {
    const std::string sealed = files::Seal(bytes);
    const auto unsealed = files::Unseal(sealed);
    Expect(unsealed.ok() && *unsealed == bytes, "what is sealed is unsealed");
  }
  std::ofstream(folder / "model.json", std::ios::binary | std::ios::trunc)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  const auto manifest = artifact::ReadModelManifest(folder);
  if (!manifest.ok()) return;
  const v1::ModelSpec& spec = manifest->spec();
  Expect(artifact::ValidateModelSpec(spec).empty(), "a manifest that is read has a valid spec");
  for (const auto& [name, shape] : artifact::TensorShapes(spec)) {
    int64_t count = 1;
    for (const int64_t size : shape) {
      Expect(size > 0, "tensors have sizes");
      Expect(!__builtin_mul_overflow(count, size, &count), "sizes of tensors do not overflow");
    }
  }
  Expect(artifact::WaypointTimes(spec.trajectory()).size() ==
             static_cast<size_t>(spec.trajectory().waypoints()),
         "each waypoint has a time");
}

}  // namespace maneuver::fuzz
