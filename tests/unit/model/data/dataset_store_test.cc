#include "model/data/dataset_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "model/data/dataset_folder.h"
#include "model/data/tfrecord.h"
#include "model/files/durable_file.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/model/data/temporary_folder.h"

namespace maneuver::data {
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
    store_ = *DatasetStore::Open(folder_ / "datasets", quota_bytes);
  }

  // Uploads bytes in pieces that end where no shard does.
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

  // Names in the store's folder, hidden ones too.
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

TEST_F(DatasetStoreTest, AnUploadBecomesADatasetThatIsThereAfterARestart) {
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

TEST_F(DatasetStoreTest, NothingIsThereBeforeTheCommitAndNothingStaysWithoutIt) {
  auto upload = store_->BeginUpload("town", manifest_);
  ASSERT_TRUE(upload.ok());
  ASSERT_TRUE((*upload)->Append(bytes_).ok());
  EXPECT_FALSE(store_->Contains("town"));
  EXPECT_THAT(*store_->List("", 10), IsEmpty());
  upload->reset();
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, WhatASuddenDeathLeftIsRemovedByTheNextStart) {
  auto upload = store_->BeginUpload("town", manifest_);
  ASSERT_TRUE(upload.ok());
  ASSERT_TRUE((*upload)->Append(bytes_.substr(0, 1000)).ok());
  EXPECT_EQ(Names().size(), 1u);
  Reopen();
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, TheQuotaIsForAllDatasetsAndForWhatIsOnItsWay) {
  const auto size = static_cast<int64_t>(bytes_.size());
  Reopen(2 * size + 100);
  ASSERT_TRUE(Upload("first", bytes_).ok());
  auto second = store_->BeginUpload("second", manifest_);
  ASSERT_TRUE(second.ok()) << second.status();
  ASSERT_TRUE((*second)->Append(std::string_view(bytes_).substr(0, 1000)).ok());
  const absl::Status third = store_->BeginUpload("third", manifest_).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(third)) << third;
  EXPECT_THAT(std::string(third.message()),
              AllOf(HasSubstr(std::to_string(size) + " bytes"), HasSubstr(" 100 are left")));
  // What is broken off or deleted makes room again.
  second->reset();
  ASSERT_TRUE(Upload("third", bytes_).ok());
  EXPECT_FALSE(store_->BeginUpload("fourth", manifest_).ok());
  ASSERT_TRUE(store_->Detach("first").ok());
  EXPECT_TRUE(store_->BeginUpload("fourth", manifest_).ok());
}

TEST_F(DatasetStoreTest, ATruncatedUploadIsRefusedByItsShard) {
  const auto result = Upload("town", bytes_.substr(0, bytes_.size() - 1));
  EXPECT_TRUE(absl::IsInvalidArgument(result.status())) << result.status();
  EXPECT_THAT(std::string(result.status().message()),
              AllOf(HasSubstr("shard " + manifest_.shards().rbegin()->file()),
                    HasSubstr("of " + std::to_string(manifest_.shards().rbegin()->size_bytes()))));
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, BytesBeyondTheLastShardAreRefused) {
  const auto result = Upload("town", bytes_ + "x");
  EXPECT_TRUE(absl::IsInvalidArgument(result.status())) << result.status();
  EXPECT_THAT(std::string(result.status().message()), HasSubstr("more bytes"));
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, AnAlteredByteIsRefusedByItsShard) {
  bytes_[static_cast<size_t>(manifest_.shards(0).size_bytes()) + 100] ^= 1;
  const auto result = Upload("town", bytes_);
  EXPECT_TRUE(absl::IsDataLoss(result.status())) << result.status();
  EXPECT_THAT(std::string(result.status().message()),
              AllOf(HasSubstr("shard " + manifest_.shards(1).file()), HasSubstr("SHA-256")));
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, ARecordingThatIsNoneIsRefusedByRecordAndField) {
  // The digests agree: it was made like this.
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

TEST_F(DatasetStoreTest, ShardsWithoutAByteAreThereToo) {
  v1::Shard empty;
  empty.set_file("annotations-00000.tfrecord");
  empty.set_content(v1::SHARD_CONTENT_ANNOTATIONS);
  empty.set_sha256("e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  *manifest_.add_shards() = empty;
  const auto result = Upload("town", bytes_);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_TRUE(std::filesystem::exists(store_->FolderOf("town") / empty.file()));
}

TEST_F(DatasetStoreTest, ANameIsTakenOnce) {
  ASSERT_TRUE(Upload("town", bytes_).ok());
  EXPECT_TRUE(absl::IsAlreadyExists(store_->BeginUpload("town", manifest_).status()));
}

TEST_F(DatasetStoreTest, OfTwoUploadsOfANameTheFirstToCommitWins) {
  auto first = store_->BeginUpload("town", manifest_);
  auto second = store_->BeginUpload("town", manifest_);
  ASSERT_TRUE(first.ok() && second.ok());
  ASSERT_TRUE((*first)->Append(bytes_).ok());
  ASSERT_TRUE((*second)->Append(bytes_).ok());
  ASSERT_TRUE((*second)->Commit().ok());
  EXPECT_TRUE(absl::IsAlreadyExists((*first)->Commit().status()));
  first->reset();
  EXPECT_TRUE(store_->Get("town").ok());
  EXPECT_THAT(Names(), ElementsAre("town"));
}

TEST_F(DatasetStoreTest, ADatasetThatCannotFitIsRefusedBeforeAByteIsSent) {
  manifest_.mutable_shards(0)->set_size_bytes(std::numeric_limits<int64_t>::max());
  manifest_.mutable_shards(1)->set_size_bytes(std::numeric_limits<int64_t>::max());
  const auto upload = store_->BeginUpload("town", manifest_);
  EXPECT_TRUE(absl::IsResourceExhausted(upload.status())) << upload.status();
  EXPECT_THAT(Names(), IsEmpty());
}

TEST_F(DatasetStoreTest, ADetachedDatasetIsGoneAtOnceAndItsNameFree) {
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

TEST_F(DatasetStoreTest, DatasetsAreListedByNameInPages) {
  for (const char* id : {"b", "c", "a"}) ASSERT_TRUE(Upload(id, bytes_).ok());
  EXPECT_THAT(*store_->List("", 2), ElementsAre("a", "b"));
  EXPECT_THAT(*store_->List("b", 2), ElementsAre("c"));
  EXPECT_THAT(*store_->List("c", 2), IsEmpty());
}

TEST_F(DatasetStoreTest, RecordingsAreListedInOrderAtAGlance) {
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

}  // namespace
}  // namespace maneuver::data
