#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <string_view>

#include "model/data/dataset_folder.h"
#include "model/data/dataset_store.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "tests/durability/publication.h"
#include "tests/unit/model/data/local_dataset.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::durability::dataset_upload_test {
namespace {

namespace fs = std::filesystem;

// Uploads those of the first `most` bytes that have not arrived. Commits once all bytes have
// arrived.
absl::Status Upload(const fs::path& folder, const std::string& id, const data::LocalDataset& local,
                    size_t most = std::string::npos) {
  auto store = data::DatasetStore::Open(folder);
  if (!store.ok()) return store.status();
  const auto answer = (*store)->QueryUpload(id, local.manifest);
  if (!answer.ok()) return answer.status();
  auto arriving = (*store)->BeginUpload(
      id, local.manifest, "", {answer->arrived_bytes().begin(), answer->arrived_bytes().end()});
  if (!arriving.ok()) return arriving.status();
  const std::string_view bytes = std::string_view(local.bytes).substr(0, most);
  size_t begin = 0;
  for (int i = 0; i < local.manifest.shards_size(); ++i) {
    const auto end = begin + static_cast<size_t>(local.manifest.shards(i).size_bytes());
    constexpr size_t kPiece = 2'000;
    for (size_t at = begin + static_cast<size_t>(answer->arrived_bytes(i));
         at < std::min(end, bytes.size()); at += kPiece) {
      const absl::Status status = (*arriving)->Append(bytes.substr(at, std::min(kPiece, end - at)));
      if (!status.ok()) return status;
    }
    begin = end;
  }
  return most < local.bytes.size() ? absl::OkStatus() : (*arriving)->Commit().status();
}

// Checks that a staged file has the name of a complete shard only if it is complete.
void CheckStagedShards(const fs::path& folder) {
  if (!fs::exists(folder / ".uploads")) return;
  for (const auto& file : fs::recursive_directory_iterator(folder / ".uploads")) {
    if (!file.is_regular_file() || file.path().extension() == ".part") continue;
    EXPECT_EQ(*files::Sha256OfFile(file.path()), file.path().filename().string());
  }
}

bool IsWholeDataset(const fs::path& folder, const std::string& id) {
  const auto store = data::DatasetStore::Open(folder);
  EXPECT_TRUE(store.ok()) << store.status();
  CheckStagedShards(folder);
  if (!fs::exists(folder / id)) return false;
  EXPECT_TRUE((*store)->Contains(id));
  const absl::Status whole = data::VerifyDatasetFolder(folder / id);
  EXPECT_TRUE(whole.ok()) << whole;
  return true;
}

TEST(DurabilityTest, AfterAPowerCutAnUploadIsAWholeDatasetOrNothing) {
  const TemporaryFolder parent;
  const data::LocalDataset local(parent / "local", 3);
  ASSERT_GE(local.manifest.shards_size(), 2);
  const int moments = CheckEveryFault(
      Publication{
          .prepare =
              [&](const fs::path& folder) { ASSERT_TRUE(Upload(folder, "old", local).ok()); },
          .publish = [&](const fs::path& folder) { return Upload(folder, "new", local); },
          .is_new =
              [&](const fs::path& folder) {
                EXPECT_TRUE(IsWholeDataset(folder, "old"));
                if (!IsWholeDataset(folder, "new")) return false;
                EXPECT_FALSE(fs::exists(folder / ".uploads")) << "nothing of it is needed any more";
                return true;
              },
      },
      parent / "faults");
  EXPECT_GE(moments, 20);
}

TEST(DurabilityTest, AfterAPowerCutAContinuedUploadIsADatasetOrCanContinue) {
  const TemporaryFolder parent;
  const data::LocalDataset local(parent / "local", 3);
  const auto first_shard = static_cast<size_t>(local.manifest.shards(0).size_bytes());
  const int moments = CheckEveryFault(
      Publication{
          .prepare =
              [&](const fs::path& folder) {
                ASSERT_TRUE(Upload(folder, "new", local, first_shard + 1'000).ok());
              },
          .publish = [&](const fs::path& folder) { return Upload(folder, "new", local); },
          .is_new = [&](const fs::path& folder) { return IsWholeDataset(folder, "new"); },
      },
      parent / "faults");
  EXPECT_GE(moments, 15);
}

TEST(DurabilityTest, BytesReportedAsArrivedSurviveAPowerCut) {
  const TemporaryFolder parent;
  const data::LocalDataset local(parent / "local", 3);
  const auto first_shard = static_cast<size_t>(local.manifest.shards(0).size_bytes());
  const int moments = CheckEveryFault(
      Publication{
          .prepare =
              [&](const fs::path& folder) { ASSERT_TRUE(Upload(folder, "old", local).ok()); },
          // A shard is acknowledged once the upload has passed it.
          .publish =
              [&](const fs::path& folder) { return Upload(folder, "new", local, first_shard + 1); },
          .is_new =
              [&](const fs::path& folder) {
                CheckStagedShards(folder);
                const auto store = data::DatasetStore::Open(folder);
                return (*store)->QueryUpload("new", local.manifest)->arrived_bytes(0) ==
                       local.manifest.shards(0).size_bytes();
              },
      },
      parent / "faults");
  EXPECT_GE(moments, 5);
}

}  // namespace
}  // namespace maneuver::durability::dataset_upload_test
