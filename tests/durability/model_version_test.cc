#include <gtest/gtest.h>

#include "model/artifact/model_folder.h"
#include "server/serving/version_folders.h"
#include "tests/durability/publication.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::durability {
namespace {

namespace fs = std::filesystem;

absl::Status PublishVersion(const fs::path& folder, int version) {
  const fs::path finished = folder / "jobs" / "model";
  // A job that goes on begins its export anew.
  fs::remove_all(finished);
  fs::create_directories(finished.parent_path());
  absl::Status status = artifact::WriteModelFolder(finished, artifact::TinyModel());
  if (!status.ok()) return status;
  const serving::VersionFolders versions(folder / "models");
  const auto scanned = versions.Scan();
  if (!scanned.ok()) return scanned.status();
  return versions.Add({"town", version}, finished, "jobs/a", std::chrono::system_clock::now());
}

TEST(DurabilityTest, AModelVersionIsThereWholeOrNotAtAll) {
  const TemporaryFolder parent;
  const int moments = CheckEveryFault(
      Publication{
          .prepare = [](const fs::path& folder) { ASSERT_TRUE(PublishVersion(folder, 1).ok()); },
          .publish = [](const fs::path& folder) { return PublishVersion(folder, 2); },
          .is_new =
              [](const fs::path& folder) {
                // What a job left behind is removed when it goes on, or with it.
                fs::remove_all(folder / "jobs");
                const serving::VersionFolders versions(folder / "models");
                const auto found = versions.Scan();
                EXPECT_TRUE(found.ok()) << found.status();
                for (const int version : found->at("town")) {
                  const auto model =
                      artifact::ReadModelFolder(versions.FolderOf({"town", version}));
                  EXPECT_TRUE(model.ok()) << model.status();
                  EXPECT_EQ(versions.Maker({"town", version}), "jobs/a");
                }
                EXPECT_TRUE(found->at("town").contains(1));
                return found->at("town").contains(2);
              },
      },
      parent / "faults");
  EXPECT_GE(moments, 20);
}

}  // namespace
}  // namespace maneuver::durability
