#include "model/learning/checkpoint.h"

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace maneuver::durability::checkpoint_test
