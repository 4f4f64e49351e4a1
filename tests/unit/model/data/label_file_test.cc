#include "model/data/label_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/files/durable_file.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::label_file_test {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::Field;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

// Recordings r0, r1 and "a, b", each with vehicle 1 and pedestrian 2 from 0 to 5 s.
class LabelFileTest : public testing::Test {
 protected:
  LabelFileTest() {
    auto writer = DatasetWriter::Create(folder_ / "town", "a test");
    for (const char* id : {"r0", "r1", "a, b"}) {
      EXPECT_TRUE((*writer)->Add(SmallRecording(id)).ok());
    }
    EXPECT_TRUE((*writer)->Commit().ok());
  }

  CheckedLabels Check(const std::string& lines, const std::set<std::string>& actions = {}) const {
    const auto labels =
        CheckLabels("recording,target,time,action\n" + lines, folder_ / "town", actions);
    EXPECT_TRUE(labels.ok()) << labels.status();
    return *labels;
  }

  // Returns each problem as "LINE: what".
  std::vector<std::string> Problems(const std::string& lines,
                                    const std::set<std::string>& actions = {}) const {
    std::vector<std::string> problems;
    for (const LabelProblem& problem : Check(lines, actions).problems) {
      problems.push_back(absl::StrCat(problem.line, ": ", problem.what));
    }
    return problems;
  }

  const TemporaryFolder folder_;
};

TEST_F(LabelFileTest, LabelsBecomeAnnotationsOfMomentsInOrder) {
  const CheckedLabels labels =
      Check("r1,1,2.5,turn_left\r\n\n\"a, b\", 1 ,0.0,keep_lane\nr0,1,5,stop");
  EXPECT_THAT(labels.problems, IsEmpty());
  ASSERT_THAT(labels.annotations, SizeIs(3));
  const v1::ManeuverAnnotation& first = labels.annotations[0];
  EXPECT_EQ(first.scenario_id(), "r1");
  EXPECT_EQ(first.agent_id(), 1);
  EXPECT_EQ(first.start_time(), 2.5);
  EXPECT_EQ(first.end_time(), 2.5);
  EXPECT_EQ(first.maneuver(), "turn_left");
  EXPECT_EQ(labels.annotations[1].scenario_id(), "a, b");
  EXPECT_EQ(labels.annotations[2].maneuver(), "stop");
}

TEST_F(LabelFileTest, NamesEveryWrongLine) {
  EXPECT_THAT(
      Problems("r0,1,1.0\n"               // 2
               "r9,1,1.0,stop\n"          // 3
               "r0,7,1.0,stop\n"          // 4
               "r0,2,1.0,stop\n"          // 5
               "r0,1,5.1,stop\n"          // 6
               "r0,1,-0.1,stop\n"         // 7
               "r0,one,1.0,stop\n"        // 8
               "r0,1,soon,stop\n"         // 9
               "r0,1,nan,stop\n"          // 10
               "r0,1,1.0,Turn Left\n"     // 11
               "r0,1,1.0,stop\n"          // 12
               "r0,1,1.0,keep_lane\n"     // 13
               "\"r0,1,1.0,stop\n"        // 14
               ",1,1.0,stop\n"            // 15
               "r0,1,1.0,stop,surely\n")  // 16
      ,
      ElementsAre(
          "2: has 3 fields, not 4", "3: the dataset has no recording 'r9'",
          "4: recording 'r0' has no target 7", "5: target 2 of recording 'r0' is not a vehicle",
          "6: target 1 is not there at 5.1 s, but from 0 to 5",
          "7: target 1 is not there at -0.1 s, but from 0 to 5", "8: target 'one' is not a number",
          "9: time 'soon' is not a number", "10: time 'nan' is not a number",
          "11: action 'Turn Left' must match [a-z][a-z0-9_]* with at most 63 characters",
          "13: line 12 labels the same moment of the same target",
          "14: a quote is not closed, or something follows it", "15: names no recording",
          "16: has 5 fields, not 4"));
}

TEST_F(LabelFileTest, RefusesActionsThatAreNotListed) {
  EXPECT_THAT(Problems("r0,1,1.0,stop\nr0,1,2.0,stopp\n", {"stop", "go"}),
              ElementsAre("3: action 'stopp' is none of those that were named"));
}

TEST_F(LabelFileTest, RequiresTheHeader) {
  for (const char* text : {"", "\n", "r0,1,1.0,stop\n", "recording,target,action,time\n"}) {
    const auto labels = CheckLabels(text, folder_ / "town");
    ASSERT_EQ(labels->problem_count, 1) << text;
    EXPECT_THAT(labels->problems[0].what, HasSubstr("recording,target,time,action"));
  }
}

TEST_F(LabelFileTest, ListsTheFirstProblemsAndCountsAll) {
  std::string lines;
  for (int i = 0; i < 200; ++i) absl::StrAppend(&lines, "r9,1,", i, ",stop\n");
  const CheckedLabels labels = Check(lines);
  EXPECT_EQ(labels.problem_count, 200);
  ASSERT_THAT(labels.problems, SizeIs(kMostLabelProblems));
  EXPECT_EQ(labels.problems.back().line, 51);
}

TEST_F(LabelFileTest, QuotesOfALineAreShortAndPrintable) {
  const auto problems = Problems("r\x1b[31m" + std::string(10'000, 'x') + ",1,1.0,stop\n");
  ASSERT_THAT(problems, SizeIs(1));
  EXPECT_THAT(problems[0], AllOf(HasSubstr("'r?[31mxxx"), SizeIs(testing::Lt(200u))));
}

TEST_F(LabelFileTest, AnnotatingMakesANewDatasetWithTheSameRecordings) {
  const CheckedLabels labels = Check("r1,1,2.5,turn_left\n");
  for (const char* output : {"once", "twice"}) {
    const std::string source = std::string(output) == "once" ? "town" : "once";
    const auto dataset = AnnotateDataset(folder_ / source, labels.annotations, folder_ / output);
    ASSERT_TRUE(dataset.ok()) << dataset.status();
    const absl::Status whole = VerifyDatasetFolder(folder_ / output);
    EXPECT_TRUE(whole.ok()) << whole;
  }
  const auto plain = ReadDatasetManifest(folder_ / "town");
  const auto once = ReadDatasetManifest(folder_ / "once");
  EXPECT_EQ(once->shards(0).sha256(), plain->shards(0).sha256());
  EXPECT_EQ(once->shards_size(), plain->shards_size() + 1);
  EXPECT_EQ(ReadDatasetManifest(folder_ / "twice")->shards_size(), plain->shards_size() + 2);
  std::vector<std::string> actions;
  ASSERT_TRUE(ForEachAnnotation(folder_ / "twice", OnDamage::kStop,
                                [&](v1::ManeuverAnnotation&& annotation) {
                                  actions.push_back(annotation.maneuver());
                                  return true;
                                })
                  .ok());
  EXPECT_THAT(actions, ElementsAre("turn_left", "turn_left"));
}

TEST_F(LabelFileTest, CreatesNoFolderWhenItFails) {
  const CheckedLabels labels = Check("r1,1,2.5,turn_left\n");
  EXPECT_TRUE(absl::IsAlreadyExists(
      AnnotateDataset(folder_ / "town", labels.annotations, folder_ / "town").status()));
  EXPECT_FALSE(AnnotateDataset(folder_ / "none", labels.annotations, folder_ / "new").ok());
  EXPECT_FALSE(AnnotateDataset(folder_ / "town", {}, folder_ / "new").ok());
  EXPECT_TRUE(
      absl::IsCancelled(AnnotateDataset(folder_ / "town", labels.annotations, folder_ / "new", [] {
                          return true;
                        }).status()));
  int names = 0;
  for ([[maybe_unused]] const auto& entry :
       std::filesystem::directory_iterator(folder_ / "town" / "..")) {
    ++names;
  }
  EXPECT_EQ(names, 1);
}

}  // namespace
}  // namespace maneuver::data::label_file_test
