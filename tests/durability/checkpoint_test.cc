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

// As a training writes one: what it needs to go on as if it had never stopped.
learning::Checkpoint OfATraining(int epochs) {
  learning::Checkpoint checkpoint;
  checkpoint.set_settings("settings");
  checkpoint.set_training_examples(1000);
  checkpoint.set_phase("joint");
  checkpoint.set_epochs(epochs);
  checkpoint.set_random("random numbers");
  learning::StoredTensor tensor;
  tensor.add_shape(40);
  for (int i = 0; i < 160; ++i) tensor.mutable_values()->push_back(static_cast<char>(i * epochs));
  for (const char* name : {"decoder", "encoder"}) (*checkpoint.mutable_networks())[name] = tensor;
  for (int i = 0; i < 4; ++i) *checkpoint.add_moments() = tensor;
  checkpoint.set_optimizer_steps(77);
  (*checkpoint.mutable_means())["nll"].set_sum(0.25);
  checkpoint.set_start_weights_sha256("0123456789abcdef");
  return checkpoint;
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
  auto checkpoints = learning::CheckpointFolder::Open(folder, {.kept = 2});
  ASSERT_TRUE(checkpoints.ok()) << checkpoints.status();
  ASSERT_TRUE(checkpoints->Write(OfATraining(1)).ok());
  const auto before = read(folder);
  ASSERT_TRUE(before.ok());
  ASSERT_TRUE(checkpoints->Write(OfATraining(2)).ok());
  ExpectNoSilentDamage(folder, read, {*before});
}

}  // namespace
}  // namespace maneuver::durability::checkpoint_test
