#include "model/data/dataset_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "model/data/tfrecord.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::dataset_folder_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pair;
using testing::UnorderedElementsAre;

v1::ManeuverAnnotation Annotation(const std::string& scenario_id, const std::string& maneuver) {
  v1::ManeuverAnnotation annotation;
  annotation.set_scenario_id(scenario_id);
  annotation.set_agent_id(1);
  annotation.set_end_time(5.0);
  annotation.set_maneuver(maneuver);
  return annotation;
}

class DatasetFolderTest : public testing::Test {
 protected:
  // Writes recordings r0, r1, ...; with annotations of the first if `annotated`.
  v1::Dataset Write(int recordings, int64_t shard_bytes = 1 << 20, bool annotated = false) {
    auto writer = DatasetWriter::Create(folder_, "a test", {.shard_bytes = shard_bytes});
    EXPECT_TRUE(writer.ok()) << writer.status();
    for (int i = 0; i < recordings; ++i) {
      EXPECT_TRUE((*writer)->Add(SmallRecording("r" + std::to_string(i), 10.0 * (i % 2))).ok());
    }
    if (annotated) {
      EXPECT_TRUE((*writer)->Add(Annotation("r0", "keep_lane")).ok());
      EXPECT_TRUE((*writer)->Add(Annotation("r0", "turn_left")).ok());
      EXPECT_TRUE((*writer)->Add(Annotation("r0", "keep_lane")).ok());
    }
    const auto dataset = (*writer)->Commit();
    EXPECT_TRUE(dataset.ok()) << dataset.status();
    return *dataset;
  }

  std::vector<std::string> Ids(OnDamage on_damage, absl::Status* status, int64_t* skipped) {
    std::vector<std::string> ids;
    *status = ForEachScenario(
        folder_, on_damage,
        [&ids](v1::Scenario&& scenario) {
          ids.push_back(scenario.scenario_id());
          return true;
        },
        skipped);
    return ids;
  }

  // Applies `change` to a shard's bytes.
  void Alter(const std::string& file, const std::function<void(std::string*)>& change) {
    std::string bytes = *files::ReadFile(folder_ / file);
    change(&bytes);
    WriteBytes(folder_ / file, bytes);
  }

  // Replaces the first shard by one with these payloads, and adapts the manifest.
  void ReplaceShard(const std::vector<std::string>& payloads) {
    v1::Dataset manifest = *ReadDatasetManifest(folder_);
    v1::Shard* shard = manifest.mutable_shards(0);
    std::filesystem::remove(folder_ / shard->file());
    auto writer = TfRecordWriter::Create(folder_ / shard->file());
    for (const std::string& payload : payloads) ASSERT_TRUE((*writer)->Append(payload).ok());
    ASSERT_TRUE((*writer)->Close().ok());
    shard->set_size_bytes((*writer)->size_bytes());
    shard->set_records((*writer)->records());
    shard->set_sha256((*writer)->sha256());
    manifest.set_recordings((*writer)->records());
    WriteBytes(folder_ / "dataset.json", PrintDatasetManifest(manifest));
  }

  TemporaryFolder parent_;
  std::filesystem::path folder_ = parent_ / "town";
};

TEST_F(DatasetFolderTest, CommitPublishesShardsAndManifestAndLeavesNoTemporary) {
  const v1::Dataset dataset = Write(3, 1 << 20, true);
  EXPECT_THAT(parent_.Names(), ElementsAre("town"));
  EXPECT_EQ(dataset.recordings(), 3);
  EXPECT_NEAR(dataset.duration_seconds(), 15.0, 1e-9);
  EXPECT_EQ(dataset.origin(), "a test");
  EXPECT_GT(dataset.create_time().seconds(), 0);
  ASSERT_EQ(dataset.shards_size(), 2);
  EXPECT_EQ(dataset.shards(0).file(), "scenarios-00000.tfrecord");
  EXPECT_EQ(dataset.shards(0).records(), 3);
  EXPECT_EQ(dataset.shards(1).file(), "annotations-00000.tfrecord");
  EXPECT_EQ(dataset.shards(1).records(), 3);
  for (const v1::Shard& shard : dataset.shards()) {
    EXPECT_EQ(*files::Sha256OfFile(folder_ / shard.file()), shard.sha256());
    EXPECT_EQ(std::filesystem::file_size(folder_ / shard.file()),
              static_cast<uintmax_t>(shard.size_bytes()));
  }
  const auto read = ReadDatasetManifest(folder_);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->SerializeAsString(), dataset.SerializeAsString());
  EXPECT_TRUE(VerifyDatasetFolder(folder_).ok()) << VerifyDatasetFolder(folder_);
}

TEST_F(DatasetFolderTest, WithoutCommitNothingRemains) {
  {
    auto writer = DatasetWriter::Create(folder_, "");
    ASSERT_TRUE((*writer)->Add(SmallRecording("r0")).ok());
  }
  EXPECT_THAT(parent_.Names(), IsEmpty());
}

TEST_F(DatasetFolderTest, NeverTouchesAnExistingFolder) {
  std::filesystem::create_directory(folder_);
  EXPECT_EQ(DatasetWriter::Create(folder_, "").status().code(), absl::StatusCode::kAlreadyExists);
  EXPECT_THAT(parent_.Names(), ElementsAre("town"));
}

TEST_F(DatasetFolderTest, DoesNotReplaceAFolderThatAppearsMeanwhile) {
  {
    auto writer = DatasetWriter::Create(folder_, "");
    ASSERT_TRUE((*writer)->Add(SmallRecording("r0")).ok());
    std::filesystem::create_directory(folder_);
    EXPECT_EQ((*writer)->Commit().status().code(), absl::StatusCode::kAlreadyExists);
  }
  EXPECT_THAT(parent_.Names(), ElementsAre("town"));
  EXPECT_TRUE(std::filesystem::is_empty(folder_));
}

TEST_F(DatasetFolderTest, RefusesToCommitAnEmptyDataset) {
  auto writer = DatasetWriter::Create(folder_, "");
  EXPECT_EQ((*writer)->Commit().status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST_F(DatasetFolderTest, CommitsNothingThatNobodyCouldRead) {
  auto writer = DatasetWriter::Create(folder_, std::string(1001, 'a'));
  ASSERT_TRUE((*writer)->Add(SmallRecording("r", 1.0)).ok());
  const absl::Status status = (*writer)->Commit().status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(status.message().find("origin"), std::string::npos);
  writer->reset();
  EXPECT_FALSE(std::filesystem::exists(folder_));
}

TEST_F(DatasetFolderTest, RefusesInvalidRecordingsAndContinues) {
  auto writer = DatasetWriter::Create(folder_, "");
  EXPECT_EQ((*writer)->Add(SmallRecording("")).code(), absl::StatusCode::kInvalidArgument);
  v1::Scenario invalid = SmallRecording("invalid");
  invalid.mutable_agents(0)->set_length(-1.0);
  const absl::Status status = (*writer)->Add(invalid);
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("scenario invalid: agents[0].length"));
  EXPECT_TRUE((*writer)->Add(SmallRecording("r0")).ok());
  EXPECT_EQ((*writer)->Add(SmallRecording("r0")).code(), absl::StatusCode::kAlreadyExists);
  EXPECT_EQ((*writer)->Commit()->recordings(), 1);
}

TEST_F(DatasetFolderTest, ShardsRollOverAndKeepTheOrder) {
  const v1::Dataset dataset = Write(5, 1);  // each shard is full after one record
  EXPECT_EQ(dataset.shards_size(), 5);
  EXPECT_EQ(dataset.shards(4).file(), "scenarios-00004.tfrecord");
  absl::Status status;
  EXPECT_THAT(Ids(OnDamage::kStop, &status, nullptr), ElementsAre("r0", "r1", "r2", "r3", "r4"));
  EXPECT_TRUE(status.ok()) << status;
}

TEST_F(DatasetFolderTest, StopsVisitingWhenAsked) {
  Write(5, 1);
  int visited = 0;
  EXPECT_TRUE(ForEachScenario(folder_, OnDamage::kStop, [&](v1::Scenario&&) {
                return ++visited < 2;
              }).ok());
  EXPECT_EQ(visited, 2);
}

TEST_F(DatasetFolderTest, ReadsAllRecordingsInOrderOnAnyNumberOfThreads) {
  Write(9, 20'000);
  for (const int threads : {0, 1, 4, 20}) {
    const auto recordings = ReadRecordings(folder_, threads);
    ASSERT_TRUE(recordings.ok()) << recordings.status();
    ASSERT_EQ(recordings->size(), 9u);
    for (int i = 0; i < 9; ++i) {
      EXPECT_EQ((*recordings)[i].SerializeAsString(),
                SmallRecording("r" + std::to_string(i), 10.0 * (i % 2)).SerializeAsString());
    }
  }
}

TEST_F(DatasetFolderTest, FindsOneRecordingById) {
  Write(4, 1);
  EXPECT_EQ(ReadScenario(folder_, "r2")->scenario_id(), "r2");
  EXPECT_EQ(ReadScenario(folder_, "r9").status().code(), absl::StatusCode::kNotFound);
}

TEST_F(DatasetFolderTest, StopsAtOrSkipsADamagedRecordAsAsked) {
  const v1::Dataset dataset = Write(3);
  const std::string file = dataset.shards(0).file();
  // All records have the same size, so the middle of the file is the payload of the second one.
  Alter(file, [](std::string* bytes) { (*bytes)[bytes->size() / 2] ^= 1; });

  absl::Status status;
  EXPECT_THAT(Ids(OnDamage::kStop, &status, nullptr), ElementsAre("r0"));
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(status.message()), HasSubstr("scenarios-00000.tfrecord, record at byte"));

  int64_t skipped = 0;
  EXPECT_THAT(Ids(OnDamage::kSkip, &status, &skipped), ElementsAre("r0", "r2"));
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(skipped, 1);
  EXPECT_EQ(ReadRecordings(folder_).status().code(), absl::StatusCode::kDataLoss);
}

TEST_F(DatasetFolderTest, StopsAtOrSkipsTheEndOfATruncatedShardAsAsked) {
  const std::string file = Write(4).shards(0).file();
  Alter(file, [](std::string* bytes) { bytes->resize(bytes->size() / 2 - 5); });
  absl::Status status;
  EXPECT_THAT(Ids(OnDamage::kStop, &status, nullptr), IsEmpty());
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  int64_t skipped = 0;
  EXPECT_THAT(Ids(OnDamage::kSkip, &status, &skipped), ElementsAre("r0"));
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(skipped, 3);
}

TEST_F(DatasetFolderTest, NamesAMissingShard) {
  Write(2, 1);
  std::filesystem::remove(folder_ / "scenarios-00001.tfrecord");
  const auto manifest = ReadDatasetManifest(folder_);
  EXPECT_EQ(manifest.status(), absl::DataLossError("shard scenarios-00001.tfrecord is missing"));
}

// One record replaces another of the same length, with valid CRCs: only the digest differs.
TEST_F(DatasetFolderTest, VerifyDetectsATamperedShard) {
  const v1::Dataset dataset = Write(2, 1);
  Alter(dataset.shards(0).file(), [&](std::string* bytes) {
    auto writer = TfRecordWriter::Create(parent_ / "forged");
    ASSERT_TRUE((*writer)->Append(SmallRecording("rX", 0.0).SerializeAsString()).ok());
    ASSERT_TRUE((*writer)->Close().ok());
    const std::string forged = *files::ReadFile(parent_ / "forged");
    ASSERT_EQ(forged.size(), bytes->size());
    *bytes = forged;
  });
  ASSERT_TRUE(ReadDatasetManifest(folder_).ok());
  const absl::Status status = VerifyDatasetFolder(folder_);
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(status.message()), HasSubstr("scenarios-00000.tfrecord has SHA-256"));
}

TEST_F(DatasetFolderTest, VerifyDetectsAWrongRecordCount) {
  Write(2);
  v1::Dataset manifest = *ReadDatasetManifest(folder_);
  manifest.mutable_shards(0)->set_records(3);
  manifest.set_recordings(3);
  WriteBytes(folder_ / "dataset.json", PrintDatasetManifest(manifest));
  EXPECT_EQ(
      VerifyDatasetFolder(folder_),
      absl::DataLossError("shard scenarios-00000.tfrecord has 2 records; dataset.json says 3"));
}

TEST_F(DatasetFolderTest, VerifyDetectsInvalidRecords) {
  Write(1);
  v1::Scenario invalid = SmallRecording("invalid");
  invalid.mutable_map_features(0)->add_x(1.0);
  const struct {
    std::vector<std::string> payloads;
    const char* message;
  } cases[] = {
      {{"\xff\xff not a message"}, "not a Scenario"},
      {{SmallRecording("").SerializeAsString()}, "a scenario with an id"},
      {{invalid.SerializeAsString()}, "(scenario invalid): map_features[0]"},
      {{SmallRecording("a").SerializeAsString(), SmallRecording("a").SerializeAsString()},
       "scenario a is in the dataset twice"},
  };
  for (const auto& c : cases) {
    ReplaceShard(c.payloads);
    const absl::Status status = VerifyDatasetFolder(folder_);
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
    EXPECT_THAT(std::string(status.message()), HasSubstr(c.message));
  }
}

TEST_F(DatasetFolderTest, VerifyDetectsAnAnnotationWithoutARecording) {
  auto writer = DatasetWriter::Create(folder_, "");
  ASSERT_TRUE((*writer)->Add(SmallRecording("r0")).ok());
  ASSERT_TRUE((*writer)->Add(Annotation("elsewhere", "keep_lane")).ok());
  ASSERT_TRUE((*writer)->Commit().ok());
  EXPECT_EQ(VerifyDatasetFolder(folder_).code(), absl::StatusCode::kDataLoss);
}

TEST_F(DatasetFolderTest, ReadsAnnotationsInOrder) {
  Write(1, 1 << 20, true);
  std::vector<std::string> maneuvers;
  ASSERT_TRUE(ForEachAnnotation(folder_, OnDamage::kStop, [&](v1::ManeuverAnnotation&& annotation) {
                maneuvers.push_back(annotation.maneuver());
                return true;
              }).ok());
  EXPECT_THAT(maneuvers, ElementsAre("keep_lane", "turn_left", "keep_lane"));
}

TEST_F(DatasetFolderTest, DescribeCountsTheContent) {
  Write(4, 1 << 20, true);  // two recordings with a standing vehicle, two with a moving one
  v1::ModelSpec spec;
  spec.mutable_raster()->set_history_frames(11);
  spec.mutable_raster()->mutable_frame_interval()->set_nanos(100'000'000);
  spec.mutable_trajectory()->set_waypoints(20);
  spec.mutable_trajectory()->mutable_waypoint_interval()->set_nanos(100'000'000);
  v1::ExampleSettings settings;
  settings.mutable_stride()->set_nanos(500'000'000);
  settings.set_keep_standing(0.0001);  // counted nevertheless
  settings.set_standing_distance(1.0);
  const auto summary = DescribeDataset(folder_, spec, settings);
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_EQ(summary->dataset().recordings(), 4);
  EXPECT_THAT(summary->agents_by_type(),
              UnorderedElementsAre(Pair("VEHICLE", 4), Pair("PEDESTRIAN", 4)));
  EXPECT_THAT(summary->map_features_by_type(), UnorderedElementsAre(Pair("LANE_CENTERLINE", 4)));
  // At 1.0, 1.5, ... 3.0 of each vehicle.
  EXPECT_EQ(summary->examples(), 20);
  EXPECT_EQ(summary->standing_examples(), 10);
  EXPECT_THAT(summary->maneuvers(),
              UnorderedElementsAre(Pair("keep_lane", 2), Pair("turn_left", 1)));
}

}  // namespace
}  // namespace maneuver::data::dataset_folder_test
