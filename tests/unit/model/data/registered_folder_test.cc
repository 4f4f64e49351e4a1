// Datasets in place: what may be registered, what is read from it, and what is noticed afterwards.

#include "model/data/registered_folder.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "model/data/dataset_folder.h"
#include "model/data/dataset_store.h"
#include "model/files/durable_file.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::registered_folder_test {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class RegisteredFolderTest : public testing::Test {
 protected:
  RegisteredFolderTest() {
    Write(town_, "town");
    Write(folder_ / "private" / "secret", "secret");
    Open({folder_ / "volume"});
  }

  // Writes three recordings in at least two shards.
  static void Write(const fs::path& folder, const std::string& prefix) {
    fs::create_directories(folder.parent_path());
    auto writer = DatasetWriter::Create(folder, "a test", {.shard_bytes = 3'000});
    for (int i = 0; i < 3; ++i) {
      ASSERT_TRUE((*writer)->Add(SmallRecording(prefix + std::to_string(i))).ok());
    }
    ASSERT_TRUE((*writer)->Commit().ok());
  }

  void Open(const std::vector<fs::path>& roots, int64_t quota_bytes = 0) {
    store_ =
        *DatasetStore::Open(folder_ / "datasets", {.quota_bytes = quota_bytes, .folders = roots});
  }

  // Returns the names in the store's folder.
  std::vector<std::string> Stored() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_ / "datasets")) {
      names.push_back(entry.path().filename());
    }
    return names;
  }

  // Changes a byte of the first shard's content. With keep_times its size and its time of
  // modification stay, as `cp -p` and `touch -r` leave them.
  fs::path Damage(bool keep_times) const {
    const fs::path shard = town_ / ReadDatasetManifest(town_)->shards(0).file();
    struct stat before {};
    EXPECT_EQ(stat(shard.c_str(), &before), 0);
    std::string bytes = *files::ReadFile(shard);
    bytes[bytes.size() / 2] ^= 1;
    std::ofstream(shard) << bytes;
    const timespec times[2] = {before.st_atim, before.st_mtim};
    if (keep_times) {
      EXPECT_EQ(utimensat(AT_FDCWD, shard.c_str(), times, 0), 0);
    }
    return shard.filename();
  }

  const TemporaryFolder folder_;
  const fs::path town_ = folder_ / "volume" / "town";
  std::unique_ptr<DatasetStore> store_;
};

TEST_F(RegisteredFolderTest, ADatasetInPlaceIsReadWhereItLies) {
  const auto registered = store_->Register("town", town_);
  ASSERT_TRUE(registered.ok()) << registered.status();
  EXPECT_EQ(registered->name(), "datasets/town");
  EXPECT_EQ(registered->recordings(), 3);
  EXPECT_THAT(registered->origin(), AllOf(HasSubstr(town_.string()), HasSubstr("a test")));
  EXPECT_EQ(store_->Get("town")->DebugString(), registered->DebugString());
  EXPECT_EQ(store_->GetScenario("town", "town1")->scenario_id(), "town1");
  EXPECT_EQ(store_->ListScenarios("town", 0, 10)->size(), 3u);
  EXPECT_TRUE(VerifyDatasetFolder(store_->FolderOf("town")).ok());
  // No copy, and nothing written beside the shards.
  for (const v1::Shard& shard : registered->shards()) {
    EXPECT_TRUE(fs::is_symlink(store_->FolderOf("town") / shard.file()));
  }
  // It is there after a restart.
  Open({});
  EXPECT_EQ(store_->GetScenario("town", "town2")->scenario_id(), "town2");
}

TEST_F(RegisteredFolderTest, WritesNothingIntoTheFolder) {
  for (const auto& entry : fs::directory_iterator(town_)) {
    if (entry.path().extension() == ".index") fs::remove(entry.path());
  }
  const auto names = [this] {
    std::vector<std::string> all;
    for (const auto& entry : fs::directory_iterator(town_)) all.push_back(entry.path().filename());
    return all;
  };
  const std::vector<std::string> before = names();
  ASSERT_TRUE(store_->Register("town", town_).ok());
  EXPECT_TRUE(store_->GetScenario("town", "town0").ok());
  EXPECT_EQ(names(), before);
}

TEST_F(RegisteredFolderTest, DeletionLeavesTheFolder) {
  ASSERT_TRUE(store_->Register("town", town_).ok());
  const auto detached = store_->Detach("town");
  ASSERT_TRUE(detached.ok()) << detached.status();
  fs::remove_all(*detached);
  EXPECT_THAT(Stored(), IsEmpty());
  EXPECT_TRUE(VerifyDatasetFolder(town_).ok());
  EXPECT_TRUE(store_->Register("again", town_).ok());
}

TEST_F(RegisteredFolderTest, RefusesFoldersThatTheConfigurationDoesNotName) {
  fs::create_directory_symlink(folder_ / "private", folder_ / "volume" / "way-out");
  fs::create_directories(folder_ / "volume-2");
  for (const fs::path& folder :
       {folder_ / "private" / "secret", folder_ / "volume" / ".." / "private" / "secret",
        folder_ / "volume" / "way-out" / "secret", folder_ / "volume-2", fs::path("/"),
        folder_ / "private" / "nothing", folder_ / "volume" / ".." / "nothing"}) {
    const absl::Status refused = store_->Register("secret", folder).status();
    EXPECT_TRUE(absl::IsPermissionDenied(refused)) << folder << ": " << refused;
    EXPECT_THAT(std::string(refused.message()), HasSubstr("--dataset-folders"));
  }
  EXPECT_TRUE(absl::IsInvalidArgument(store_->Register("town", "volume/town").status()));
  EXPECT_TRUE(absl::IsInvalidArgument(store_->Register("town", folder_ / "volume/none").status()));
  Open({});
  EXPECT_TRUE(absl::IsPermissionDenied(store_->Register("town", town_).status()));
  EXPECT_THAT(Stored(), IsEmpty());
}

TEST_F(RegisteredFolderTest, ARootMayItselfBeALink) {
  fs::create_directory_symlink(folder_ / "volume", folder_ / "mnt");
  Open({folder_ / "mnt"});
  const auto registered = store_->Register("town", folder_ / "mnt" / "town");
  ASSERT_TRUE(registered.ok()) << registered.status();
  EXPECT_THAT(registered->origin(), HasSubstr(town_.string()));
}

TEST_F(RegisteredFolderTest, RefusesShardsThatAreLinks) {
  const std::string shard = ReadDatasetManifest(town_)->shards(1).file();
  fs::rename(town_ / shard, folder_ / "private" / shard);
  fs::create_symlink(folder_ / "private" / shard, town_ / shard);
  const absl::Status refused = store_->Register("town", town_).status();
  EXPECT_TRUE(absl::IsInvalidArgument(refused)) << refused;
  EXPECT_THAT(std::string(refused.message()), AllOf(HasSubstr(shard), HasSubstr("link")));
  EXPECT_THAT(Stored(), IsEmpty());
}

TEST_F(RegisteredFolderTest, VerifiesEverythingFirst) {
  const fs::path shard = Damage(/*keep_times=*/false);
  const absl::Status refused = store_->Register("town", town_).status();
  EXPECT_TRUE(absl::IsInvalidArgument(refused)) << refused;
  EXPECT_THAT(std::string(refused.message()), HasSubstr(shard.string()));
  EXPECT_THAT(Stored(), IsEmpty());
  fs::remove(town_ / "dataset.json");
  EXPECT_TRUE(absl::IsInvalidArgument(store_->Register("town", town_).status()));
}

TEST_F(RegisteredFolderTest, NamesAShardThatHasChanged) {
  for (const bool keep_times : {false, true}) {
    fs::remove_all(town_);
    Write(town_, "town");
    const std::string id = keep_times ? "kept" : "new";
    ASSERT_TRUE(store_->Register(id, town_).ok());
    const fs::path shard = Damage(keep_times);
    for (const absl::Status& status :
         {store_->Get(id).status(), store_->GetScenario(id, "town2").status(),
          store_->ListScenarios(id, 0, 10).status(),
          ForEachScenario(store_->FolderOf(id), OnDamage::kStop,
                          [](v1::Scenario&&) { return true; })}) {
      EXPECT_TRUE(absl::IsDataLoss(status)) << status;
      EXPECT_THAT(std::string(status.message()),
                  AllOf(HasSubstr(shard.string()), HasSubstr(town_.string())));
    }
  }
}

TEST_F(RegisteredFolderTest, NamesAShardThatIsGone) {
  ASSERT_TRUE(store_->Register("town", town_).ok());
  const std::string shard = ReadDatasetManifest(town_)->shards(1).file();
  fs::remove(town_ / shard);
  const absl::Status gone = store_->Get("town").status();
  EXPECT_TRUE(absl::IsDataLoss(gone)) << gone;
  EXPECT_THAT(std::string(gone.message()), HasSubstr(shard));
  EXPECT_TRUE(store_->Detach("town").ok());
}

TEST_F(RegisteredFolderTest, AcceptsARewrittenFileWithTheSameContent) {
  ASSERT_TRUE(store_->Register("town", town_).ok());
  const std::string shard = ReadDatasetManifest(town_)->shards(0).file();
  fs::copy_file(town_ / shard, town_ / "restored");
  fs::rename(town_ / "restored", town_ / shard);
  EXPECT_TRUE(store_->Get("town").ok());
  EXPECT_TRUE(store_->GetScenario("town", "town0").ok());
}

TEST_F(RegisteredFolderTest, ARepeatedRegistrationAnswersAsTheFirst) {
  const auto first = store_->Register("town", town_);
  const auto again = store_->Register("town", town_ / "..");
  EXPECT_FALSE(again.ok());
  const auto repeated = store_->Register("town", town_ / ".." / "town");
  ASSERT_TRUE(repeated.ok()) << repeated.status();
  EXPECT_EQ(repeated->DebugString(), first->DebugString());
  Write(folder_ / "volume" / "other", "other");
  EXPECT_TRUE(absl::IsAlreadyExists(store_->Register("town", folder_ / "volume/other").status()));
}

TEST_F(RegisteredFolderTest, TakesNothingOfTheQuota) {
  Open({folder_ / "volume"}, /*quota_bytes=*/1'000'000);
  ASSERT_TRUE(store_->Register("town", town_).ok());
  v1::Dataset manifest = *ReadDatasetManifest(town_);
  int64_t bytes = 0;
  for (const v1::Shard& shard : manifest.shards()) bytes += shard.size_bytes();
  Open({folder_ / "volume"}, /*quota_bytes=*/bytes);
  EXPECT_TRUE(store_->BeginUpload("uploaded", manifest).ok());
}

}  // namespace
}  // namespace maneuver::data::registered_folder_test
