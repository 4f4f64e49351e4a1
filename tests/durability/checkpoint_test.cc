#include "model/learning/checkpoint.h"

#include <gtest/gtest.h>

#include "tests/durability/corruption.h"
#include "tests/durability/publication.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::durability::checkpoint_test {
namespace {

namespace fs = std::filesystem;

absl::Status WriteCheckpoint(const fs::path& folder, int epochs) {
  auto checkpoints = learning::CheckpointFolder::Open(folder, {.kept = 2});
  if (!checkpoints.ok()) return checkpoints.status();
  learning::Checkpoint checkpoint;
  checkpoint.set_phase("joint");
  checkpoint.set_epochs(epochs);
  return checkpoints->Write(checkpoint);
}

TEST(DurabilityTest, AfterAPowerCutTheLastCheckpointOrTheOneBeforeIsWhole) {
  const TemporaryFolder parent;
  const int moments = CheckEveryFault(
      Publication{
          .prepare =
              [](const fs::path& folder) {
                for (int epochs = 1; epochs <= 3; ++epochs) {
                  ASSERT_TRUE(WriteCheckpoint(folder, epochs).ok());
                }
              },
          .publish = [](const fs::path& folder) { return WriteCheckpoint(folder, 4); },
          .is_new =
              [](const fs::path& folder) {
                const auto checkpoints = learning::CheckpointFolder::Open(folder, {.kept = 2});
                EXPECT_TRUE(checkpoints.ok()) << checkpoints.status();
                const auto latest = checkpoints->ReadLatest();
                EXPECT_TRUE(latest.has_value());
                EXPECT_GE(latest->epochs(), 3);
                return latest->epochs() == 4;
              },
      },
      parent / "faults");
  EXPECT_GE(moments, 5);
}

TEST(CorruptionTest, ADamagedCheckpointIsPassedOver) {
  const TemporaryFolder parent;
  const fs::path folder = parent / "checkpoints";
  const ReadAll read = [](const fs::path& each) -> absl::StatusOr<std::string> {
    const auto checkpoints = learning::CheckpointFolder::Open(each, {.kept = 2});
    if (!checkpoints.ok()) return checkpoints.status();
    const auto latest = checkpoints->ReadLatest();
    if (!latest) return absl::NotFoundError("no whole checkpoint");
    return latest->DebugString();
  };
  ASSERT_TRUE(WriteCheckpoint(folder, 1).ok());
  const auto before = read(folder);
  ASSERT_TRUE(before.ok());
  ASSERT_TRUE(WriteCheckpoint(folder, 2).ok());
  ExpectNoSilentDamage(folder, read, {*before});
}

}  // namespace
}  // namespace maneuver::durability::checkpoint_test
