#include "model/data/dataset_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <vector>

#include "model/data/dataset_folder.h"
#include "model/data/tfrecord.h"
#include "model/files/durable_file.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::dataset_store_test {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class DatasetStoreTest : public testing::Test {
 protected:
  void SetUp() override {
    Reopen();
    // Three recordings in two shards, as a client has them.
    auto writer = DatasetWriter::Create(folder_ / "local", "a test", {.shard_bytes = 3'000});
    for (int i = 0; i < 3; ++i) {
      ASSERT_TRUE((*writer)->Add(SmallRecording("r" + std::to_string(i))).ok());
    }
    manifest_ = *(*writer)->Commit();
    ASSERT_GE(manifest_.shards_size(), 2);
    for (const v1::Shard& shard : manifest_.shards()) {
      bytes_ += *files::ReadFile(folder_ / "local" / shard.file());
    }
  }

  void Reopen(int64_t quota_bytes = 0) {
    store_ = *DatasetStore::Open(folder_ / "datasets", {.quota_bytes = quota_bytes});
  }

  // Uploads bytes in pieces whose boundaries differ from those of the shards.
  absl::StatusOr<v1::Dataset> Upload(const std::string& id, const std::string& bytes) {
    auto upload = store_->BeginUpload(id, manifest_);
    if (!upload.ok()) return upload.status();
    constexpr size_t kPiece = 777;
    for (size_t at = 0; at < bytes.size(); at += kPiece) {
      const absl::Status status = (*upload)->Append(std::string_view(bytes).substr(at, kPiece));
      if (!status.ok()) return status;
    }
    return (*upload)->Commit();
  }

  // Uploads the first bytes and breaks off.
  void BreakOffAfter(size_t bytes, const std::string& caller = "") {
    auto upload = store_->BeginUpload("town", manifest_, caller, Arrived(caller));
    ASSERT_TRUE(upload.ok()) << upload.status();
    ASSERT_TRUE((*upload)->Append(std::string_view(bytes_).substr(0, bytes)).ok());
  }

  // Returns the arrived bytes of each shard of "town".
  std::vector<int64_t> Arrived(const std::string& caller = "") const {
    const auto answer = store_->QueryUpload("town", manifest_, caller);
    EXPECT_TRUE(answer.ok()) << answer.status();
    return {answer->arrived_bytes().begin(), answer->arrived_bytes().end()};
  }

  // Uploads the bytes of "town" that have not arrived.
  absl::StatusOr<v1::Dataset> GoOn(const std::string& caller = "") {
    const std::vector<int64_t> arrived = Arrived(caller);
    auto upload = store_->BeginUpload("town", manifest_, caller, arrived);
    if (!upload.ok()) return upload.status();
    size_t begin = 0;
    for (int i = 0; i < manifest_.shards_size(); ++i) {
      const auto size = static_cast<size_t>(manifest_.shards(i).size_bytes());
      const auto there = static_cast<size_t>(arrived[static_cast<size_t>(i)]);
      const absl::Status status =
          (*upload)->Append(std::string_view(bytes_).substr(begin + there, size - there));
      if (!status.ok()) return status;
      begin += size;
    }
    return (*upload)->Commit();
  }

  size_t FirstShardBytes() const { return static_cast<size_t>(manifest_.shards(0).size_bytes()); }

  // Returns the file of a shard that an interrupted upload left.
  std::filesystem::path StagedFile(int shard, const std::string& suffix) const {
    for (const auto& slot :
         std::filesystem::directory_iterator(folder_ / "datasets" / ".uploads")) {
      return slot.path() / (manifest_.shards(shard).sha256() + suffix);
    }
    return {};
  }

  static void AlterAByte(const std::filesystem::path& file) {
    std::string content = *files::ReadFile(file);
    content[content.size() / 2] ^= 1;
    ASSERT_TRUE(files::WriteFileAtomically(file, content).ok());
  }

  // Returns the names in the store's folder, including hidden ones.
  std::vector<std::string> Names() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / "datasets")) {
      names.push_back(entry.path().filename());
    }
    return names;
  }

  const TemporaryFolder folder_;
  std::unique_ptr<DatasetStore> store_;
  v1::Dataset manifest_;
  std::string bytes_;
};

TEST_F(DatasetStoreTest, ACommittedUploadIsADatasetAfterARestart) {
  const auto uploaded = Upload("town", bytes_);
  ASSERT_TRUE(uploaded.ok()) << uploaded.status();
  EXPECT_EQ(uploaded->name(), "datasets/town");
  EXPECT_TRUE(uploaded->has_create_time());
  EXPECT_THAT(Names(), ElementsAre("town"));
  Reopen();
  const auto found = store_->Get("town");
  ASSERT_TRUE(found.ok()) << found.status();
  EXPECT_EQ(found->SerializeAsString(), uploaded->SerializeAsString());
  EXPECT_EQ(found->recordings(), 3);
  EXPECT_EQ(store_->GetScenario("town", "r2")->SerializeAsString(),
            SmallRecording("r2").SerializeAsString());
}

TEST_F(DatasetStoreTest, NothingIsADatasetBeforeTheCommit) {
  auto upload = store_->BeginUpload("town", manifest_);
  ASSERT_TRUE(upload.ok());
  ASSERT_TRUE((*upload)->Append(bytes_).ok());
  EXPECT_FALSE(store_->Contains("town"));
  EXPECT_THAT(NamesOf(store_->List("", 10)), IsEmpty());
}

TEST_F(DatasetStoreTest, AnUploadWithoutBytesLeavesNothing) {
  ASSERT_TRUE(store_->BeginUpload("town", manifest_).ok());
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, ADiscardedUploadLeavesNothing) {
  auto upload = store_->BeginUpload("town", manifest_);
  ASSERT_TRUE((*upload)->Append(bytes_).ok());
  (*upload)->Discard();
  upload->reset();
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, ArrivedBytesSurviveARestartAndAreNotSentAgain) {
  BreakOffAfter(FirstShardBytes() + 500);
  Reopen();
  EXPECT_FALSE(store_->Contains("town"));
  const std::vector<int64_t> arrived = Arrived();
  EXPECT_EQ(arrived[0], manifest_.shards(0).size_bytes());
  EXPECT_EQ(arrived[1], 500);
  const auto dataset = GoOn();
  ASSERT_TRUE(dataset.ok()) << dataset.status();
  EXPECT_TRUE(VerifyDatasetFolder(store_->FolderOf("town")).ok());
  EXPECT_THAT(Names(), ElementsAre("town"));
}

TEST_F(DatasetStoreTest, ContinuesFromFewerBytesThanArrivedButNotFromMore) {
  BreakOffAfter(1'000);
  std::vector<int64_t> claimed = Arrived();
  ASSERT_EQ(claimed[0], 1'000);
  claimed[0] = 1'001;
  EXPECT_TRUE(absl::IsUnavailable(store_->BeginUpload("town", manifest_, "", claimed).status()));
  claimed[0] = 300;
  auto upload = store_->BeginUpload("town", manifest_, "", claimed);
  ASSERT_TRUE(upload.ok()) << upload.status();
  ASSERT_TRUE((*upload)->Append(std::string_view(bytes_).substr(300)).ok());
  EXPECT_TRUE((*upload)->Commit().ok());
}

TEST_F(DatasetStoreTest, CallersDoNotShareArrivedBytes) {
  BreakOffAfter(bytes_.size(), "ada");
  EXPECT_THAT(Arrived("ada"), testing::Contains(testing::Gt(0)));
  EXPECT_THAT(Arrived("bob"), testing::Each(0));
  EXPECT_THAT(Arrived(""), testing::Each(0));
  EXPECT_TRUE(
      absl::IsUnavailable(store_->BeginUpload("town", manifest_, "bob", Arrived("ada")).status()));
  // Nor can the same caller use it under another name.
  const auto other = store_->QueryUpload("other", manifest_, "ada");
  EXPECT_THAT(other->arrived_bytes(), testing::Each(0));
}

TEST_F(DatasetStoreTest, DiscardsAPartialShardThatTurnsOutWrong) {
  BreakOffAfter(1'000);
  AlterAByte(StagedFile(0, ".part"));
  const absl::Status wrong = GoOn().status();
  EXPECT_TRUE(absl::IsDataLoss(wrong)) << wrong;
  EXPECT_EQ(Arrived()[0], 0);
  const auto dataset = GoOn();
  EXPECT_TRUE(dataset.ok()) << dataset.status();
}

TEST_F(DatasetStoreTest, DiscardsAShardThatTheDiskAlteredAndKeepsTheOthers) {
  BreakOffAfter(bytes_.size());
  AlterAByte(StagedFile(0, ""));
  const absl::Status wrong = GoOn().status();
  EXPECT_TRUE(absl::IsDataLoss(wrong)) << wrong;
  EXPECT_THAT(std::string(wrong.message()), HasSubstr(manifest_.shards(0).file()));
  EXPECT_EQ(Arrived()[0], 0);
  EXPECT_EQ(Arrived()[1], manifest_.shards(1).size_bytes());
  const auto dataset = GoOn();
  EXPECT_TRUE(dataset.ok()) << dataset.status();
}

TEST_F(DatasetStoreTest, ALaterUploadByTheSameCallerTakesOver) {
  auto first = store_->BeginUpload("town", manifest_);
  ASSERT_TRUE(first.ok());
  ASSERT_TRUE((*first)->Append(std::string_view(bytes_).substr(0, FirstShardBytes() + 100)).ok());
  // Its connection is broken, but the server has not noticed.
  const std::vector<int64_t> arrived = Arrived();
  ASSERT_EQ(arrived[0], manifest_.shards(0).size_bytes());
  auto second = store_->BeginUpload("town", manifest_, "", arrived);
  ASSERT_TRUE(second.ok()) << second.status();
  const absl::Status taken_over = (*first)->Append("rubbish");
  EXPECT_TRUE(absl::IsAborted(taken_over)) << taken_over;
  EXPECT_TRUE(absl::IsAborted((*first)->Commit().status()));
  const size_t there = FirstShardBytes() + static_cast<size_t>(arrived[1]);
  ASSERT_TRUE((*second)->Append(std::string_view(bytes_).substr(there, 50)).ok());
  first->reset();  // removes nothing
  ASSERT_TRUE((*second)->Append(std::string_view(bytes_).substr(there + 50)).ok());
  const auto dataset = (*second)->Commit();
  EXPECT_TRUE(dataset.ok()) << dataset.status();
}

TEST_F(DatasetStoreTest, ASecondUploadReusesShardsThatAlreadyArrived) {
  BreakOffAfter(bytes_.size());
  const std::filesystem::path given_up = StagedFile(1, "");
  ASSERT_TRUE(std::filesystem::exists(given_up));
  manifest_.mutable_shards()->DeleteSubrange(1, manifest_.shards_size() - 1);
  manifest_.set_recordings(manifest_.shards(0).records());
  EXPECT_EQ(Arrived()[0], manifest_.shards(0).size_bytes());
  auto upload = store_->BeginUpload("town", manifest_, "", Arrived());
  ASSERT_TRUE(upload.ok());
  EXPECT_FALSE(std::filesystem::exists(given_up));
  EXPECT_TRUE((*upload)->Commit().ok());
}

TEST_F(DatasetStoreTest, QueryUploadReturnsACommittedDataset) {
  EXPECT_FALSE(store_->QueryUpload("town", manifest_)->has_committed());
  ASSERT_TRUE(Upload("town", bytes_).ok());
  EXPECT_EQ(store_->QueryUpload("town", manifest_)->committed().name(), "datasets/town");
  manifest_.mutable_shards(0)->mutable_sha256()->front() ^= 1;
  EXPECT_FALSE(store_->QueryUpload("town", manifest_)->has_committed());
}

TEST_F(DatasetStoreTest, RemovesAbandonedUploadsAfterTheirTime) {
  const auto now = std::filesystem::file_time_type::clock::now();
  BreakOffAfter(1'000);
  ASSERT_TRUE(store_->RemoveAbandonedUploads(now + std::chrono::hours(23)).ok());
  EXPECT_EQ(Arrived()[0], 1'000);
  {
    const auto upload = store_->BeginUpload("town", manifest_, "", Arrived());
    ASSERT_TRUE(store_->RemoveAbandonedUploads(now + std::chrono::hours(25)).ok());
    EXPECT_EQ(Arrived()[0], 1'000) << "somebody is at it";
  }
  ASSERT_TRUE(store_->RemoveAbandonedUploads(now + std::chrono::hours(25)).ok());
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, OpeningRemovesUploadsThatAreTooOld) {
  BreakOffAfter(1'000);
  const auto old = std::filesystem::file_time_type::clock::now() - std::chrono::hours(25);
  const std::filesystem::path part = StagedFile(0, ".part");
  std::filesystem::last_write_time(part, old);
  std::filesystem::last_write_time(part.parent_path(), old);
  Reopen();
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, OpeningRemovesWhatACrashedCommitLeft) {
  auto temporary = files::MakeTemporaryFolderFor(folder_ / "datasets" / "town");
  ASSERT_TRUE(temporary.ok());
  Reopen();
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, TheQuotaCoversDatasetsAndUploadsInProgress) {
  const auto size = static_cast<int64_t>(bytes_.size());
  Reopen(2 * size + 100);
  ASSERT_TRUE(Upload("first", bytes_).ok());
  auto second = store_->BeginUpload("town", manifest_);
  ASSERT_TRUE(second.ok()) << second.status();
  ASSERT_TRUE((*second)->Append(std::string_view(bytes_).substr(0, 1000)).ok());
  const absl::Status third = store_->BeginUpload("third", manifest_).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(third)) << third;
  EXPECT_THAT(std::string(third.message()),
              AllOf(HasSubstr(std::to_string(size) + " bytes"), HasSubstr(" 100 are left")));
  // Arrived bytes count against other uploads, but not against their own.
  second->reset();
  const absl::Status fourth = store_->BeginUpload("fourth", manifest_).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(fourth)) << fourth;
  EXPECT_THAT(std::string(fourth.message()), HasSubstr("interrupted uploads hold 1000"));
  ASSERT_TRUE(GoOn().ok());
  // Deleting makes room.
  EXPECT_FALSE(store_->BeginUpload("fourth", manifest_).ok());
  ASSERT_TRUE(store_->Detach("first").ok());
  EXPECT_TRUE(store_->BeginUpload("fourth", manifest_).ok());
}

TEST_F(DatasetStoreTest, RefusesATruncatedUploadAndNamesTheShard) {
  const auto result = Upload("town", bytes_.substr(0, bytes_.size() - 1));
  EXPECT_TRUE(absl::IsInvalidArgument(result.status())) << result.status();
  EXPECT_THAT(std::string(result.status().message()),
              AllOf(HasSubstr("shard " + manifest_.shards().rbegin()->file()),
                    HasSubstr("of " + std::to_string(manifest_.shards().rbegin()->size_bytes()))));
  EXPECT_FALSE(store_->Contains("town"));
}

TEST_F(DatasetStoreTest, RefusesBytesBeyondTheLastShard) {
  const auto result = Upload("town", bytes_ + "x");
  EXPECT_TRUE(absl::IsInvalidArgument(result.status())) << result.status();
  EXPECT_THAT(std::string(result.status().message()), HasSubstr("more bytes"));
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, RefusesAnAlteredByteAndNamesTheShard) {
  bytes_[static_cast<size_t>(manifest_.shards(0).size_bytes()) + 100] ^= 1;
  const auto result = Upload("town", bytes_);
  EXPECT_TRUE(absl::IsDataLoss(result.status())) << result.status();
  EXPECT_THAT(std::string(result.status().message()),
              AllOf(HasSubstr("shard " + manifest_.shards(1).file()), HasSubstr("SHA-256")));
  EXPECT_FALSE(store_->Contains("town"));
  EXPECT_EQ(Arrived()[1], 0);
}

TEST_F(DatasetStoreTest, RefusesAnInvalidRecordingAndNamesRecordAndField) {
  // The digests match: the recording was invalid from the start.
  v1::Scenario bad = SmallRecording("bad");
  bad.mutable_agents(0)->set_length(-1.0);
  auto writer = TfRecordWriter::Create(folder_ / "bad.tfrecord");
  ASSERT_TRUE((*writer)->Append(SmallRecording("good").SerializeAsString()).ok());
  ASSERT_TRUE((*writer)->Append(bad.SerializeAsString()).ok());
  ASSERT_TRUE((*writer)->Close().ok());
  v1::Shard* shard = manifest_.mutable_shards(0);
  manifest_.mutable_shards()->DeleteSubrange(1, manifest_.shards_size() - 1);
  shard->set_size_bytes((*writer)->size_bytes());
  shard->set_records(2);
  shard->set_sha256((*writer)->sha256());
  manifest_.set_recordings(2);
  const auto result = Upload("town", *files::ReadFile(folder_ / "bad.tfrecord"));
  EXPECT_TRUE(absl::IsInvalidArgument(result.status())) << result.status();
  EXPECT_THAT(std::string(result.status().message()),
              AllOf(HasSubstr(shard->file()), HasSubstr("bad"), HasSubstr("agents[0].length")));
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, CommitCreatesEmptyShards) {
  v1::Shard empty;
  empty.set_file("annotations-00000.tfrecord");
  empty.set_content(v1::SHARD_CONTENT_ANNOTATIONS);
  empty.set_sha256("e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  *manifest_.add_shards() = empty;
  const auto result = Upload("town", bytes_);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_TRUE(std::filesystem::exists(store_->FolderOf("town") / empty.file()));
}

TEST_F(DatasetStoreTest, RefusesANameThatExists) {
  ASSERT_TRUE(Upload("town", bytes_).ok());
  EXPECT_TRUE(absl::IsAlreadyExists(store_->BeginUpload("town", manifest_).status()));
}

TEST_F(DatasetStoreTest, TheFirstOfTwoCallersToCommitANameWins) {
  auto first = store_->BeginUpload("town", manifest_, "ada");
  auto second = store_->BeginUpload("town", manifest_, "bob");
  ASSERT_TRUE(first.ok() && second.ok());
  ASSERT_TRUE((*first)->Append(bytes_).ok());
  ASSERT_TRUE((*second)->Append(bytes_).ok());
  ASSERT_TRUE((*second)->Commit().ok());
  EXPECT_TRUE(absl::IsAlreadyExists((*first)->Commit().status()));
  first->reset();
  EXPECT_TRUE(store_->Get("town").ok());
  EXPECT_THAT(Names(), ElementsAre("town"));
}

TEST_F(DatasetStoreTest, RefusesADatasetThatCannotFitBeforeAnyByteIsSent) {
  manifest_.mutable_shards(0)->set_size_bytes(std::numeric_limits<int64_t>::max());
  manifest_.mutable_shards(1)->set_size_bytes(std::numeric_limits<int64_t>::max());
  const auto upload = store_->BeginUpload("town", manifest_);
  EXPECT_TRUE(absl::IsResourceExhausted(upload.status())) << upload.status();
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, DetachingFreesTheNameAtOnce) {
  ASSERT_TRUE(Upload("town", bytes_).ok());
  ASSERT_EQ(store_->ListScenarios("town", 0, 10)->size(), 3u);
  const auto detached = store_->Detach("town");
  ASSERT_TRUE(detached.ok()) << detached.status();
  EXPECT_TRUE(absl::IsNotFound(store_->Get("town").status()));
  EXPECT_TRUE(absl::IsNotFound(store_->ListScenarios("town", 0, 10).status()));
  EXPECT_TRUE(absl::IsNotFound(store_->GetScenario("town", "r0").status()));
  EXPECT_TRUE(absl::IsNotFound(store_->Describe("town", {}, {}).status()));
  EXPECT_TRUE(absl::IsNotFound(store_->Detach("town").status()));
  EXPECT_TRUE(std::filesystem::exists(*detached));
  ASSERT_TRUE(Upload("town", bytes_).ok());
  Reopen();
  EXPECT_THAT(Names(), ElementsAre("town"));
}

TEST_F(DatasetStoreTest, ListsDatasetsByNameInPages) {
  for (const char* id : {"b", "c", "a"}) ASSERT_TRUE(Upload(id, bytes_).ok());
  EXPECT_THAT(NamesOf(store_->List("", 2)), ElementsAre("datasets/a", "datasets/b"));
  EXPECT_THAT(NamesOf(store_->List("b", 2)), ElementsAre("datasets/c"));
  EXPECT_THAT(NamesOf(store_->List("c", 2)), IsEmpty());
}

TEST_F(DatasetStoreTest, KeepsADescriptionForTheSameSettings) {
  ASSERT_TRUE(Upload("town", bytes_).ok());
  v1::ModelSpec spec;
  spec.mutable_raster()->set_history_frames(11);
  spec.mutable_raster()->mutable_frame_interval()->set_nanos(100'000'000);
  spec.mutable_trajectory()->set_waypoints(4);
  spec.mutable_trajectory()->mutable_waypoint_interval()->set_nanos(500'000'000);
  v1::ExampleSettings settings;
  settings.mutable_stride()->set_seconds(1);
  const auto counted = store_->Describe("town", spec, settings);
  ASSERT_TRUE(counted.ok()) << counted.status();
  EXPECT_EQ(counted->examples(), 9);
  EXPECT_EQ(counted->dataset().name(), "datasets/town");
  // The second description must not read the shards.
  const std::filesystem::path shard = store_->FolderOf("town") / manifest_.shards(0).file();
  std::filesystem::resize_file(shard, 0);
  std::filesystem::resize_file(shard, FirstShardBytes());
  const auto kept = store_->Describe("town", spec, settings);
  ASSERT_TRUE(kept.ok()) << kept.status();
  EXPECT_EQ(kept->DebugString(), counted->DebugString());
  settings.mutable_stride()->set_seconds(2);
  EXPECT_TRUE(absl::IsDataLoss(store_->Describe("town", spec, settings).status()));
}

TEST_F(DatasetStoreTest, ListsSummariesOfRecordingsInOrder) {
  ASSERT_TRUE(Upload("town", bytes_).ok());
  for (int read = 0; read < 2; ++read) {  // from the disk, then from memory
    const auto scenarios = store_->ListScenarios("town", 1, 5);
    ASSERT_TRUE(scenarios.ok()) << scenarios.status();
    ASSERT_EQ(scenarios->size(), 2u);
    const v1::ScenarioSummary& first = (*scenarios)[0];
    EXPECT_EQ(first.scenario_id(), "r1");
    EXPECT_EQ(first.start_time(), 0.0);
    EXPECT_DOUBLE_EQ(first.end_time(), 5.0);
    EXPECT_EQ(first.agents(), 2);
    EXPECT_EQ(first.vehicles(), 1);
    EXPECT_EQ(first.map_points(), 2);
  }
  EXPECT_EQ(store_->ListScenarios("town", 0, 1)->size(), 1u);
  EXPECT_THAT(*store_->ListScenarios("town", 9, 1), IsEmpty());
}

TEST_F(DatasetStoreTest, APageReadsItsOwnRecordingsAlone) {
  ASSERT_TRUE(Upload("town", bytes_).ok());
  ASSERT_EQ(store_->ListScenarios("town", 0, 10)->size(), 3u);
  // All of the first shard, with the recordings that it has.
  const std::filesystem::path shard = store_->FolderOf("town") / manifest_.shards(0).file();
  std::filesystem::resize_file(shard, 0);
  std::filesystem::resize_file(shard, FirstShardBytes());
  const auto damaged = static_cast<size_t>(manifest_.shards(0).records());
  ASSERT_LT(damaged, 3u);
  EXPECT_TRUE(absl::IsDataLoss(store_->ListScenarios("town", 0, 10).status()));
  EXPECT_EQ(store_->ListScenarios("town", damaged, 10)->size(), 3u - damaged);
  EXPECT_TRUE(store_->GetScenario("town", "r2").ok());
  EXPECT_TRUE(absl::IsDataLoss(store_->GetScenario("town", "r0").status()));
}

TEST_F(DatasetStoreTest, ANewDatasetOfTheSameNameHasItsOwnRecordings) {
  ASSERT_TRUE(Upload("town", bytes_).ok());
  ASSERT_TRUE(store_->GetScenario("town", "r0").ok());
  ASSERT_TRUE(store_->Detach("town").ok());
  EXPECT_TRUE(absl::IsNotFound(store_->GetScenario("town", "r0").status()));
  ASSERT_TRUE(Upload("town", bytes_).ok());
  EXPECT_TRUE(store_->GetScenario("town", "r0").ok());
}

TEST_F(DatasetStoreTest, MoreRecordingsThanFitAreIndexedAnewEachTime) {
  ASSERT_TRUE(Upload("town", bytes_).ok());
  const auto manifest = store_->Read("town");
  for (const size_t most : {size_t{2}, size_t{3}}) {
    OpenedIndexes indexes(most);
    const auto first = indexes.Open(store_->FolderOf("town"), *manifest);
    const auto second = indexes.Open(store_->FolderOf("town"), *manifest);
    ASSERT_TRUE(first.ok() && second.ok());
    EXPECT_EQ((*first)->numbers.size(), 3u);
    EXPECT_EQ(*first == *second, most == 3u);
  }
}

}  // namespace
}  // namespace maneuver::data::dataset_store_test
