#include <gtest/gtest.h>

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_folder.h"
#include "server/serving/version_store.h"
#include "tests/durability/faulty_disk.h"
#include "tests/durability/publication.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::durability::model_version_test {
namespace {

namespace fs = std::filesystem;

absl::Status PublishNextVersion(const fs::path& folder) {
  const fs::path finished = folder / "jobs" / "model";
  // A resumed job begins its export again.
  fs::remove_all(finished);
  fs::create_directories(finished.parent_path());
  absl::Status status = artifact::WriteModelFolder(finished, artifact::TinyModel());
  if (!status.ok()) return status;
  const auto versions = serving::VersionStore::Open(folder / "models");
  if (!versions.ok()) return versions.status();
  return (*versions)
      ->Publish("town", finished, {"jobs/a"},
                [](const security::ModelVersionName&) { return absl::OkStatus(); })
      .status();
}

TEST(DurabilityTest, AfterAPowerCutAModelVersionIsWholeOrAbsent) {
  const TemporaryFolder parent;
  const int moments = CheckEveryFault(
      Publication{
          .prepare = [](const fs::path& folder) { ASSERT_TRUE(PublishNextVersion(folder).ok()); },
          .publish = [](const fs::path& folder) { return PublishNextVersion(folder); },
          .is_new =
              [](const fs::path& folder) {
                // The remains of a job are removed when it resumes or is deleted.
                fs::remove_all(folder / "jobs");
                const auto versions = serving::VersionStore::Open(folder / "models");
                EXPECT_TRUE(versions.ok()) << versions.status();
                for (const auto& version : (*versions)->List("")) {
                  const auto model = artifact::ReadModelFolder((*versions)->FolderOf(version.name));
                  EXPECT_TRUE(model.ok()) << model.status();
                }
                EXPECT_TRUE((*versions)->Contains({"town", 1}));
                EXPECT_FALSE((*versions)->Contains({"town", 3}));
                const bool is_new = (*versions)->Contains({"town", 2});
                EXPECT_EQ((*versions)->FindMadeBy("town", "jobs/a"),
                          (security::ModelVersionName{"town", is_new ? 2 : 1}));
                return is_new;
              },
      },
      parent / "faults");
  EXPECT_GE(moments, 20);
}

// What a server shows that lived through an error of its disk is what is there, and the next version
// can be published.
TEST(DurabilityTest, AfterAnErrorTheStoreKnowsWhichVersionsAreThere) {
  const TemporaryFolder parent;
  const auto always = [](const security::ModelVersionName&) { return absl::OkStatus(); };
  for (const bool deletes : {false, true}) {
    int at = 0;
    for (int operations = 1; at < operations; ++at) {
      SCOPED_TRACE(absl::StrCat(deletes ? "delete" : "publish", ", operation ", at));
      const fs::path folder = parent / absl::StrCat(deletes, "-", at);
      fs::create_directory(folder);
      ASSERT_TRUE(PublishNextVersion(folder).ok());
      const auto store = serving::VersionStore::Open(folder / "models");
      ASSERT_TRUE(store.ok()) << store.status();
      const fs::path finished = folder / "finished";
      const auto publish = [&] {
        EXPECT_TRUE(artifact::WriteModelFolder(finished, artifact::TinyModel()).ok());
        const absl::Status status = (*store)->Publish("town", finished, {"b"}, always).status();
        fs::remove_all(finished);
        return status;
      };
      EXPECT_TRUE(artifact::WriteModelFolder(finished, artifact::TinyModel()).ok());
      Arm(folder, Fault::kError, at);
      const absl::Status changed =
          deletes ? (*store)->Delete({"town", 1})
                  : (*store)->Publish("town", finished, {"b"}, always).status();
      // One that fails may be the last.
      operations = std::max(Disarm(), changed.ok() ? 0 : at + 2);
      fs::remove_all(finished);
      for (const int version : {1, 2}) {
        EXPECT_EQ((*store)->Contains({"town", version}),
                  fs::exists((*store)->FolderOf({"town", version})))
            << "version " << version << " after: " << changed;
      }
      EXPECT_TRUE(publish().ok()) << "after: " << changed;
    }
    EXPECT_GE(at, deletes ? 3 : 8);
  }
}

}  // namespace
}  // namespace maneuver::durability::model_version_test
