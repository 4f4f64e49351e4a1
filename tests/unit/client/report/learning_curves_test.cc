#include "client/report/learning_curves.h"

#include <gmock/gmock.h>
#include <google/protobuf/io/coded_stream.h>
#include <gtest/gtest.h>

#include <bit>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "client/report/tensorboard.h"
#include "model/data/tfrecord.h"
#include "tests/unit/client/report/made_up_report.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::report::learning_curves_test {
namespace {

using google::protobuf::io::CodedInputStream;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

TEST(LearningPhasesTest, KeepsTheOrderOfPhasesAndTheLastReportOfAnEpoch) {
  std::vector<v1::JobProgress> events = {MadeUpEpoch("pretrain", 1, 1), MadeUpEpoch("joint", 1, 2),
                                         MadeUpEpoch("joint", 2, 3), MadeUpEpoch("joint", 2, 3)};
  (*events[3].mutable_epoch_report()->mutable_training())["loss"] = 7.0;
  v1::JobProgress between;  // within an epoch
  between.set_phase("joint");
  events.insert(events.begin() + 2, between);
  const std::vector<LearningPhase> phases = LearningPhases(events);
  ASSERT_EQ(phases.size(), 2);
  EXPECT_EQ(phases[0].name, "pretrain");
  EXPECT_EQ(phases[1].name, "joint");
  ASSERT_EQ(phases[1].epochs.size(), 2);
  EXPECT_EQ(phases[1].epochs[1].epoch_report().training().at("loss"), 7.0);
}

TEST(CurvesCsvTest, WritesOneFigurePerLine) {
  const std::vector<v1::JobProgress> events = {MadeUpEpoch("pretrain", 2, 40)};
  EXPECT_EQ(CurvesCsv(LearningPhases(events)),
            "phase,epoch,step,examples,term,value\n"
            "pretrain,2,40,training,divergence,0.25\n"
            "pretrain,2,40,training,loss,2\n"
            "pretrain,2,40,held-out,loss,2.25\n");
}

TEST(CurvesCsvTest, QuotesNamesThatNeedIt) {
  std::vector<v1::JobProgress> events = {MadeUpEpoch("pre,train", 1, 1)};
  (*events[0].mutable_epoch_report()->mutable_training())["a\"b"] = 1.0;
  const std::string csv = CurvesCsv(LearningPhases(events));
  EXPECT_THAT(csv, HasSubstr("\n\"pre,train\",1,1,training,\"a\"\"b\",1\n"));
}

// What TensorBoard would read, by the field numbers of its own schema.
struct ReadEvent {
  double wall_time = 0.0;
  int64_t step = 0;
  std::string file_version;
  std::map<std::string, float> scalars;
};

template <typename Field>
void ForEachField(const std::string& message, Field field) {
  CodedInputStream in(reinterpret_cast<const uint8_t*>(message.data()),
                      static_cast<int>(message.size()));
  while (const uint32_t tag = in.ReadTag()) {
    uint64_t number = 0;
    uint32_t bits = 0;
    std::string bytes;
    switch (tag & 7) {  // the wire type; the field's number is above it
      case 0:
        ASSERT_TRUE(in.ReadVarint64(&number));
        break;
      case 1:
        ASSERT_TRUE(in.ReadLittleEndian64(&number));
        break;
      case 5:
        ASSERT_TRUE(in.ReadLittleEndian32(&bits));
        break;
      default:
        ASSERT_TRUE(in.ReadVarint64(&number));
        ASSERT_TRUE(in.ReadString(&bytes, static_cast<int>(number)));
    }
    field(static_cast<int>(tag >> 3), number, bits, bytes);
  }
}

ReadEvent Parse(const std::string& record) {
  ReadEvent event;
  ForEachField(record, [&](int number, uint64_t value, uint32_t, const std::string& bytes) {
    if (number == 1) event.wall_time = std::bit_cast<double>(value);
    if (number == 2) event.step = static_cast<int64_t>(value);
    if (number == 3) event.file_version = bytes;
    if (number != 5) return;
    ForEachField(bytes, [&](int one, uint64_t, uint32_t, const std::string& figure) {
      ASSERT_EQ(one, 1);
      std::string tag;
      float scalar = 0.0F;
      ForEachField(figure, [&](int part, uint64_t, uint32_t bits, const std::string& text) {
        if (part == 1) tag = text;
        if (part == 2) scalar = std::bit_cast<float>(bits);
      });
      event.scalars[tag] = scalar;
    });
  });
  return event;
}

std::vector<ReadEvent> ReadRun(const std::filesystem::path& folder) {
  std::vector<ReadEvent> events;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    EXPECT_THAT(entry.path().filename().string(), HasSubstr("tfevents"));
    auto reader = data::TfRecordReader::Open(entry.path());
    EXPECT_TRUE(reader.ok()) << reader.status();
    std::string record;
    while ((*reader)->Next(&record).ok()) events.push_back(Parse(record));
  }
  return events;
}

TEST(TensorBoardTest, WritesOneRunForTrainingAndOneForHeldOutExamples) {
  const TemporaryFolder folder;
  const std::vector<v1::JobProgress> events = {MadeUpEpoch("pretrain", 1, 10),
                                               MadeUpEpoch("joint", 1, 30)};
  for (int i = 0; i < 2; ++i) {  // the second time replaces the first one's files
    const absl::Status status = WriteTensorBoard(LearningPhases(events), folder / "runs");
    ASSERT_TRUE(status.ok()) << status;
  }
  const std::vector<ReadEvent> training = ReadRun(folder / "runs" / "training");
  ASSERT_EQ(training.size(), 3);
  EXPECT_EQ(training[0].file_version, "brain.Event:2");
  EXPECT_EQ(training[1].step, 10);
  EXPECT_EQ(training[1].wall_time, 1'700'000'010.0);
  EXPECT_EQ(training[1].scalars.at("pretrain/loss"), 4.0F);
  EXPECT_EQ(training[2].step, 30);
  EXPECT_EQ(training[2].scalars.at("joint/divergence"), 0.5F);
  EXPECT_EQ(ReadRun(folder / "runs" / "held-out")[1].scalars.at("pretrain/loss"), 4.5F);
  EXPECT_EQ(ReadRun(folder / "runs" / "mixture")[1].scalars.at("joint/effective_actions"), 4.0F);
}

TEST(TensorBoardTest, NamesAFolderThatCannotBeWritten) {
  const std::vector<v1::JobProgress> events = {MadeUpEpoch("joint", 1, 1)};
  const absl::Status status = WriteTensorBoard(LearningPhases(events), "/dev/null/runs");
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()),
              StartsWith("cannot write into the folder /dev/null/runs/training"));
}

}  // namespace
}  // namespace maneuver::report::learning_curves_test
