#include "model/data/recording_blocks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "model/data/dataset_folder.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::recording_blocks_test {
namespace {

using testing::ElementsAre;

class RecordingBlocksTest : public testing::Test {
 protected:
  // Writes r0 .. r6, two to a shard.
  void SetUp() override {
    auto writer = DatasetWriter::Create(folder_, "a test", {.shard_bytes = 2 * Size()});
    ASSERT_TRUE(writer.ok()) << writer.status();
    for (int i = 0; i < 7; ++i) {
      ASSERT_TRUE((*writer)->Add(SmallRecording("r" + std::to_string(i), 0.0)).ok());
    }
    ASSERT_TRUE((*writer)->Commit().ok());
  }

  // Bytes that each recording takes on disk, without its frame.
  static int64_t Size() { return static_cast<int64_t>(SmallRecording("r0", 0.0).ByteSizeLong()); }

  // The ids of the recordings, "r0 r1 r2" for each block.
  static std::vector<std::string> IdsOf(const RecordingBlocks& blocks) {
    std::vector<std::string> ids;
    const absl::Status status = blocks.ForEach([&ids](std::span<const v1::Scenario> block) {
      std::string& of_block = ids.emplace_back();
      for (const v1::Scenario& recording : block) {
        of_block += (of_block.empty() ? "" : " ") + recording.scenario_id();
      }
      return absl::OkStatus();
    });
    EXPECT_TRUE(status.ok()) << status;
    return ids;
  }

  absl::StatusOr<RecordingBlocks> Open(int64_t data_memory) {
    return RecordingBlocks::Open(folder_, data_memory, [this] { return going_; });
  }

  const TemporaryFolder temporary_;
  const std::filesystem::path folder_ = temporary_.path() / "dataset";
  bool going_ = true;
};

TEST_F(RecordingBlocksTest, RecordingsThatFitAreOneBlockAndAreReadOnce) {
  const auto bytes = RecordingBytes(folder_);
  ASSERT_TRUE(bytes.ok()) << bytes.status();
  EXPECT_GT(*bytes, 7 * Size());
  const auto blocks = Open(*bytes * kMemoryPerByte);
  ASSERT_TRUE(blocks.ok()) << blocks.status();
  EXPECT_EQ(blocks->recordings(), 7);
  std::filesystem::remove_all(folder_);
  EXPECT_THAT(IdsOf(*blocks), ElementsAre("r0 r1 r2 r3 r4 r5 r6"));
}

TEST_F(RecordingBlocksTest, ABlockTakesHalfOfTheMemory) {
  const auto blocks = Open(2 * kMemoryPerByte * (3 * Size() + Size() / 2));
  ASSERT_TRUE(blocks.ok()) << blocks.status();
  EXPECT_EQ(blocks->recordings(), 7);
  for (int pass = 0; pass < 2; ++pass) {
    EXPECT_THAT(IdsOf(*blocks), ElementsAre("r0 r1 r2", "r3 r4 r5", "r6"));
  }
}

TEST_F(RecordingBlocksTest, BlocksHoldTheWantedRecordingsAlone) {
  for (const int64_t data_memory :
       {2 * kMemoryPerByte * (2 * Size() + Size() / 2), 1000 * Size()}) {
    const auto blocks = RecordingBlocks::Open(
        folder_, data_memory, [] { return true; },
        [](const std::string& id) { return id != "r1" && id != "r6"; });
    ASSERT_TRUE(blocks.ok()) << blocks.status();
    std::string all;
    for (const std::string& ids : IdsOf(*blocks)) all += ids + " ";
    EXPECT_EQ(all, "r0 r2 r3 r4 r5 ");
  }
}

TEST_F(RecordingBlocksTest, ARecordingThatIsLargerThanTheMemoryIsABlock) {
  const auto blocks = Open(1);
  ASSERT_TRUE(blocks.ok()) << blocks.status();
  EXPECT_THAT(IdsOf(*blocks), ElementsAre("r0", "r1", "r2", "r3", "r4", "r5", "r6"));
}

TEST_F(RecordingBlocksTest, EndsWithTheErrorOfAVisitAndWhenItIsStopped) {
  const auto blocks = Open(1);
  ASSERT_TRUE(blocks.ok()) << blocks.status();
  int visits = 0;
  const auto fail = [&](std::span<const v1::Scenario>) {
    return ++visits == 2 ? absl::AbortedError("enough") : absl::OkStatus();
  };
  EXPECT_EQ(blocks->ForEach(fail).code(), absl::StatusCode::kAborted);
  EXPECT_EQ(visits, 2);
  going_ = false;
  EXPECT_EQ(blocks->ForEach(fail).code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(visits, 2);
  EXPECT_EQ(Open(int64_t{1} << 40).status().code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace maneuver::data::recording_blocks_test
