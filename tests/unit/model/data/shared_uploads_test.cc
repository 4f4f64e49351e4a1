// Uploads to two servers that share the folder of datasets.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "model/data/dataset_folder.h"
#include "model/data/dataset_store.h"
#include "model/files/durable_file.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::shared_uploads_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class SharedUploadsTest : public testing::Test {
 protected:
  void SetUp() override {
    Reopen(0);
    auto writer = DatasetWriter::Create(folder_ / "local", "a test", {.shard_bytes = 3'000});
    for (int i = 0; i < 3; ++i) {
      ASSERT_TRUE((*writer)->Add(SmallRecording("r" + std::to_string(i))).ok());
    }
    manifest_ = *(*writer)->Commit();
    for (const v1::Shard& shard : manifest_.shards()) {
      bytes_ += *files::ReadFile(folder_ / "local" / shard.file());
    }
  }

  void Reopen(int64_t quota_bytes) {
    for (auto* store : {&a_, &b_}) {
      *store = *DatasetStore::Open(folder_ / "datasets",
                                   {.quota_bytes = quota_bytes, .is_shared = true});
    }
  }

  std::vector<int64_t> Arrived(const DatasetStore& store) const {
    const auto answer = store.QueryUpload("town", manifest_);
    EXPECT_TRUE(answer.ok()) << answer.status();
    return {answer->arrived_bytes().begin(), answer->arrived_bytes().end()};
  }
  // The bytes that follow those that have arrived.
  std::string Rest(const std::vector<int64_t>& arrived) const {
    std::string rest;
    size_t begin = 0;
    for (int i = 0; i < manifest_.shards_size(); ++i) {
      const auto size = static_cast<size_t>(manifest_.shards(i).size_bytes());
      const auto there = static_cast<size_t>(arrived[static_cast<size_t>(i)]);
      rest += bytes_.substr(begin + there, size - there);
      begin += size;
    }
    return rest;
  }

  const TemporaryFolder folder_;
  std::unique_ptr<DatasetStore> a_;
  std::unique_ptr<DatasetStore> b_;
  v1::Dataset manifest_;
  std::string bytes_;
};

TEST_F(SharedUploadsTest, AnUploadThatBrokeOffContinuesThroughAnotherServer) {
  {
    auto upload = a_->BeginUpload("town", manifest_);
    ASSERT_TRUE(upload.ok()) << upload.status();
    ASSERT_TRUE((*upload)->Append(bytes_.substr(0, bytes_.size() / 2)).ok());
  }
  const std::vector<int64_t> arrived = Arrived(*b_);
  const std::string rest = Rest(arrived);
  EXPECT_EQ(rest.size(), bytes_.size() - bytes_.size() / 2);
  auto upload = b_->BeginUpload("town", manifest_, "", arrived);
  ASSERT_TRUE(upload.ok()) << upload.status();
  ASSERT_TRUE((*upload)->Append(rest).ok());
  const auto committed = (*upload)->Commit();
  ASSERT_TRUE(committed.ok()) << committed.status();
  EXPECT_TRUE(VerifyDatasetFolder(a_->FolderOf("town")).ok());
  EXPECT_TRUE(a_->Get("town").ok());
  EXPECT_THAT(NamesOf(a_->List("", 10)), ElementsAre("datasets/town"));
}

TEST_F(SharedUploadsTest, ACallThroughAnotherServerTakesTheTurn) {
  auto first = a_->BeginUpload("town", manifest_);
  ASSERT_TRUE(first.ok()) << first.status();
  ASSERT_TRUE((*first)->Append(bytes_.substr(0, 100)).ok());
  auto second = b_->BeginUpload("town", manifest_);
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_TRUE(absl::IsAborted((*first)->Append(bytes_.substr(100, 100))));
  first->reset();  // leaves the files to the one that has the turn
  ASSERT_TRUE((*second)->Append(bytes_).ok());
  ASSERT_TRUE((*second)->Commit().ok());
  EXPECT_TRUE(VerifyDatasetFolder(a_->FolderOf("town")).ok());
}

TEST_F(SharedUploadsTest, TheQuotaCountsWhatOtherServersHaveAnnounced) {
  Reopen(static_cast<int64_t>(bytes_.size() * 3 / 2));
  auto first = a_->BeginUpload("town", manifest_);
  ASSERT_TRUE(first.ok()) << first.status();
  const auto refused = b_->BeginUpload("village", manifest_);
  EXPECT_TRUE(absl::IsFailedPrecondition(refused.status())) << refused.status();
  first->reset();  // it broke off before a byte came
  EXPECT_TRUE(b_->BeginUpload("village", manifest_).ok());
  EXPECT_TRUE(a_->BeginUpload("town", manifest_).ok());
}

TEST_F(SharedUploadsTest, TheQuotaCountsWhatInterruptedUploadsOfOtherServersLeft) {
  Reopen(static_cast<int64_t>(bytes_.size() * 5 / 4));
  {
    auto upload = a_->BeginUpload("town", manifest_);
    ASSERT_TRUE((*upload)->Append(bytes_.substr(0, bytes_.size() / 2)).ok());
  }
  const auto refused = b_->BeginUpload("village", manifest_);
  EXPECT_THAT(std::string(refused.status().message()), HasSubstr("interrupted uploads hold"));
  EXPECT_TRUE(b_->BeginUpload("town", manifest_, "", Arrived(*b_)).ok());
}

TEST_F(SharedUploadsTest, AServerThatStartsLeavesUploadsOfOthersAlone) {
  auto upload = a_->BeginUpload("town", manifest_);
  ASSERT_TRUE((*upload)->Append(bytes_.substr(0, bytes_.size() / 2)).ok());
  b_ = *DatasetStore::Open(folder_ / "datasets", {.is_shared = true});
  ASSERT_TRUE((*upload)->Append(bytes_.substr(bytes_.size() / 2)).ok());
  EXPECT_TRUE((*upload)->Commit().ok());
}

}  // namespace
}  // namespace maneuver::data::shared_uploads_test
