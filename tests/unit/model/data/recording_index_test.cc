#include "model/data/recording_index.h"

#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "model/data/dataset_folder.h"
#include "model/data/tfrecord.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/model/data/wire_format.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::recording_index_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class RecordingIndexTest : public testing::Test {
 protected:
  static constexpr int kRecordings = 7;

  void SetUp() override { Write(10.0); }

  // Writes r0 .. r6, two to a shard.
  //   speed: of those with odd numbers, m/s
  void Write(double speed) {
    const auto size = static_cast<int64_t>(SmallRecording("r0", 0.0).ByteSizeLong());
    auto writer = DatasetWriter::Create(folder_, "a test", {.shard_bytes = 2 * size});
    ASSERT_TRUE(writer.ok()) << writer.status();
    for (int i = 0; i < kRecordings; ++i) {
      ASSERT_TRUE((*writer)->Add(SmallRecording("r" + std::to_string(i), speed * (i % 2))).ok());
    }
    ASSERT_TRUE((*writer)->Commit().ok());
  }

  absl::StatusOr<RecordingIndex> Open() {
    reports_.clear();
    return RecordingIndex::Open(folder_,
                                [this](const std::string& what) { reports_.push_back(what); });
  }

  // Expects an index that reads each recording as a pass over the folder does.
  void ExpectReadsAll(const RecordingIndex& index) {
    ASSERT_EQ(index.entries().size(), static_cast<size_t>(kRecordings));
    const auto all = ReadRecordings(folder_, 1);
    ASSERT_TRUE(all.ok()) << all.status();
    for (const size_t i : {5, 0, 6, 3, 1, 4, 2}) {
      const auto recording = index.Read(i);
      ASSERT_TRUE(recording.ok()) << recording.status();
      EXPECT_EQ(recording->SerializeAsString(), all->at(i).SerializeAsString());
      EXPECT_EQ(index.entries()[i].scenario_id, all->at(i).scenario_id());
    }
  }

  // Applies `change` to the bytes of a file.
  void Alter(const fs::path& file, const std::function<void(std::string*)>& change) {
    std::string bytes = *files::ReadFile(file);
    change(&bytes);
    WriteBytes(file, bytes);
  }

  const TemporaryFolder parent_;
  const fs::path folder_ = parent_ / "town";
  const fs::path first_index_ = folder_ / ".scenarios-00000.tfrecord.index";
  std::vector<std::string> reports_;
};

TEST_F(RecordingIndexTest, ReadsRecordingsInAnyOrder) {
  ASSERT_GT(ReadDatasetManifest(folder_)->shards_size(), 1);
  const auto index = Open();
  ASSERT_TRUE(index.ok()) << index.status();
  ExpectReadsAll(*index);
  EXPECT_THAT(reports_, IsEmpty());
  EXPECT_EQ(index->Find("r4"), 4);
  EXPECT_EQ(index->Find("r9"), -1);
}

TEST_F(RecordingIndexTest, ACommitWritesWhatAPassOverTheShardsWouldFind) {
  const std::string committed = *files::ReadFile(first_index_);
  fs::remove(first_index_);
  ASSERT_TRUE(Open().ok());
  EXPECT_EQ(*files::ReadFile(first_index_), committed);
  EXPECT_THAT(reports_, IsEmpty());  // what was never there is not named
}

TEST_F(RecordingIndexTest, RebuildsADamagedIndexAndNamesIt) {
  const std::string whole = *files::ReadFile(first_index_);
  const std::vector<std::function<void(std::string*)>> damages = {
      [](std::string* bytes) { (*bytes)[bytes->size() / 2] ^= 1; },
      [](std::string* bytes) { bytes->resize(bytes->size() - 1); },
      [](std::string* bytes) { bytes->resize(2); },
  };
  for (const auto& damage : damages) {
    Alter(first_index_, damage);
    const auto index = Open();
    ASSERT_TRUE(index.ok()) << index.status();
    ExpectReadsAll(*index);
    EXPECT_THAT(reports_,
                ElementsAre(HasSubstr("index .scenarios-00000.tfrecord.index is damaged")));
    EXPECT_EQ(*files::ReadFile(first_index_), whole);
  }
}

TEST_F(RecordingIndexTest, RebuildsTheIndexOfAShardThatWasReplaced) {
  const std::string stale = *files::ReadFile(first_index_);
  fs::remove_all(folder_);
  Write(12.0);
  WriteBytes(first_index_, stale);
  const auto index = Open();
  ASSERT_TRUE(index.ok()) << index.status();
  ExpectReadsAll(*index);
  EXPECT_THAT(reports_, ElementsAre(HasSubstr("is stale")));
}

TEST_F(RecordingIndexTest, ReadsAFolderThatItCannotWriteTo) {
  fs::remove(first_index_);
  fs::create_directory(first_index_);  // no file can have this name
  const auto index = Open();
  ASSERT_TRUE(index.ok()) << index.status();
  ExpectReadsAll(*index);
}

TEST_F(RecordingIndexTest, NoticesARecordingThatChanged) {
  const auto index = Open();
  ASSERT_TRUE(index.ok()) << index.status();
  const fs::path shard = folder_ / "scenarios-00000.tfrecord";
  // An undamaged record of the same size in the place of another.
  std::string other = *files::ReadFile(shard);
  const std::string payload = index->Read(0)->SerializeAsString();
  v1::Scenario changed = *index->Read(0);
  changed.set_scenario_id("x0");
  ASSERT_EQ(changed.SerializeAsString().size(), payload.size());
  auto writer = TfRecordWriter::Create(parent_ / "one");
  ASSERT_TRUE((*writer)->Append(changed.SerializeAsString()).ok());
  ASSERT_TRUE((*writer)->Close().ok());
  const std::string record = *files::ReadFile(parent_ / "one");
  other.replace(0, record.size(), record);
  WriteBytes(shard, other);
  const absl::Status replaced = index->Read(0).status();
  EXPECT_EQ(replaced.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(replaced.message()),
              HasSubstr("scenarios-00000.tfrecord, record at byte 0: not the recording r0"));
  EXPECT_TRUE(index->Read(1).ok());

  Alter(shard, [](std::string* bytes) { (*bytes)[40] ^= 1; });
  EXPECT_THAT(std::string(index->Read(0).status().message()), HasSubstr("payload is damaged"));
  Alter(shard, [](std::string* bytes) { bytes->resize(30); });
  EXPECT_THAT(std::string(index->Read(0).status().message()), HasSubstr("ends within the record"));
}

TEST_F(RecordingIndexTest, RefusesToIndexADamagedShard) {
  fs::remove(first_index_);
  Alter(folder_ / "scenarios-00000.tfrecord", [](std::string* bytes) { (*bytes)[40] ^= 1; });
  const absl::Status status = Open().status();
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(status.message()), HasSubstr("scenarios-00000.tfrecord has SHA-256"));
}

TEST_F(RecordingIndexTest, ARecordLongerThanItsFileIsDamagedThoughTheIndexAgrees) {
  constexpr int64_t kBytes = int64_t{1} << 62;
  const auto masked_crc = [](const std::string& bytes) {
    const uint32_t crc = MaskedCrc32c(bytes);
    return std::string(reinterpret_cast<const char*>(&crc), sizeof crc);
  };
  std::string shard(reinterpret_cast<const char*>(&kBytes), sizeof kBytes);
  shard += masked_crc(shard);
  v1::Dataset manifest = *ReadDatasetManifest(folder_);
  v1::Shard& first = *manifest.mutable_shards(0);
  manifest.set_recordings(manifest.recordings() - first.records() + 1);
  first.set_records(1);
  first.set_size_bytes(static_cast<int64_t>(shard.size()));
  first.set_sha256(files::Sha256Hex(shard));
  WriteBytes(folder_ / first.file(), shard);
  ASSERT_TRUE(WriteDatasetManifest(folder_, manifest).ok());
  const std::string index_message =
      Wire()
          .Varint(1, 1)
          .Bytes(2, first.sha256())
          .Message(3, Wire().Bytes(1, "r0").Varint(2, 0).Varint(3, kBytes))
          .bytes();
  WriteBytes(first_index_, masked_crc(index_message) + index_message);

  const auto index = Open();
  ASSERT_TRUE(index.ok()) << index.status();
  EXPECT_THAT(reports_, IsEmpty());
  const absl::Status read = index->Read(0).status();
  EXPECT_EQ(read.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(read.message()), HasSubstr("the file ends within the record"));
}

TEST_F(RecordingIndexTest, AManifestWithAnAbsurdCountIsDamaged) {
  v1::Dataset manifest = *ReadDatasetManifest(folder_);
  const int64_t absurd = 4'000'000'000'000'000'000;
  manifest.mutable_shards(0)->set_records(absurd);
  manifest.set_recordings(absurd + kRecordings - 2);
  std::string json;
  ASSERT_TRUE(google::protobuf::util::MessageToJsonString(manifest, &json).ok());
  WriteBytes(folder_ / "dataset.json", json);
  EXPECT_EQ(Open().status().code(), absl::StatusCode::kDataLoss) << Open().status();
}

}  // namespace
}  // namespace maneuver::data::recording_index_test
