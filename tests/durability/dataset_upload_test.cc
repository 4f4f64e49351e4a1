#include <gtest/gtest.h>

#include <string>

#include "model/data/dataset_folder.h"
#include "model/data/dataset_store.h"
#include "model/files/durable_file.h"
#include "tests/durability/publication.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/model/data/temporary_folder.h"

namespace maneuver::durability {
namespace {

namespace fs = std::filesystem;

// As a client has it.
struct LocalDataset {
  explicit LocalDataset(const fs::path& folder) {
    auto writer = data::DatasetWriter::Create(folder, "a test", {.shard_bytes = 3'000});
    for (int i = 0; i < 3; ++i) {
      EXPECT_TRUE((*writer)->Add(data::SmallRecording("r" + std::to_string(i))).ok());
    }
    manifest = *(*writer)->Commit();
    for (const v1::Shard& shard : manifest.shards()) {
      bytes += *files::ReadFile(folder / shard.file());
    }
  }
  v1::Dataset manifest;
  std::string bytes;
};

TEST(DurabilityTest, AnUploadIsADatasetOrNothing) {
  const data::TemporaryFolder parent;
  const LocalDataset local(parent / "local");
  ASSERT_GE(local.manifest.shards_size(), 2);

  const auto upload = [&](const fs::path& folder, const std::string& id) -> absl::Status {
    auto store = data::DatasetStore::Open(folder);
    if (!store.ok()) return store.status();
    auto arriving = (*store)->BeginUpload(id, local.manifest);
    if (!arriving.ok()) return arriving.status();
    const std::string_view bytes = local.bytes;
    constexpr size_t kPiece = 2'000;
    for (size_t at = 0; at < bytes.size(); at += kPiece) {
      const absl::Status status = (*arriving)->Append(bytes.substr(at, kPiece));
      if (!status.ok()) return status;
    }
    return (*arriving)->Commit().status();
  };
  const int moments = CheckEveryFault(
      Publication{
          .prepare = [&](const fs::path& folder) { ASSERT_TRUE(upload(folder, "old").ok()); },
          .publish = [&](const fs::path& folder) { return upload(folder, "new"); },
          .is_new =
              [&](const fs::path& folder) {
                const auto store = data::DatasetStore::Open(folder);
                EXPECT_TRUE(store.ok()) << store.status();
                EXPECT_EQ((*store)->GetScenario("old", "r2")->scenario_id(), "r2");
                if (!fs::exists(folder / "new")) return false;
                EXPECT_TRUE((*store)->Contains("new"));
                const absl::Status whole = data::VerifyDatasetFolder(folder / "new");
                EXPECT_TRUE(whole.ok()) << whole;
                return true;
              },
      },
      parent / "faults");
  EXPECT_GE(moments, 15);
}

}  // namespace
}  // namespace maneuver::durability
