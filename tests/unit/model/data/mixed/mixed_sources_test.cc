// Recordings of several formats side by side: examples, labels and held-out recordings hold.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/data/argoverse/argoverse_reader.h"
#include "model/data/dataset_folder.h"
#include "model/data/example_index.h"
#include "model/data/label_file.h"
#include "model/data/nuscenes/nuscenes_scene.h"
#include "model/data/nuscenes/nuscenes_tables.h"
#include "model/data/recording_groups.h"
#include "model/data/recording_split.h"
#include "model/data/stable_hash.h"
#include "tests/unit/model/data/argoverse/argoverse_fixture.h"
#include "tests/unit/model/data/nuscenes/nuscenes_fixture.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::mixed_sources_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;

constexpr int kScenes = 16;     // of nuScenes, two of each drive
constexpr int kSequences = 24;  // of Argoverse, three of each ten minutes

std::vector<v1::Scenario> NuScenes(const fs::path& root) {
  const NuScenesFixture fixture(kScenes, 13);  // 6 s
  fixture.Write(root);
  const auto scenes = ReadNuScenes(
      fixture.Tables(root), [](const absl::Status& damage) { return damage; }, [](double) {});
  EXPECT_TRUE(scenes.ok()) << scenes.status();
  std::vector<v1::Scenario> recordings;
  for (const NuScenesScene& scene : *scenes) recordings.push_back(*ScenarioOf(scene, nullptr));
  return recordings;
}

std::vector<v1::Scenario> Argoverse() {
  std::vector<v1::Scenario> recordings;
  for (int i = 0; i < kSequences; ++i) {
    recordings.push_back(
        *ParseArgoverse(ArgoverseSequence(600'000.0 + 200.0 * i), absl::StrCat(i), nullptr));
  }
  return recordings;
}

// One second of past and three of future, at 10 Hz.
v1::ModelSpec Spec() {
  v1::ModelSpec spec;
  spec.mutable_raster()->set_history_frames(11);
  spec.mutable_raster()->mutable_frame_interval()->set_nanos(100'000'000);
  spec.mutable_trajectory()->set_waypoints(30);
  spec.mutable_trajectory()->mutable_waypoint_interval()->set_nanos(100'000'000);
  return spec;
}

v1::ExampleSettings Settings() {
  v1::ExampleSettings settings;
  settings.mutable_stride()->set_nanos(500'000'000);
  settings.set_keep_standing(1.0);
  settings.set_standing_distance(1.0);
  settings.set_max_speed(45.0);
  return settings;
}

class MixedSourcesTest : public testing::Test {
 protected:
  // Writes recordings of both formats into one dataset.
  MixedSourcesTest() {
    auto writer = DatasetWriter::Create(folder_ / "mixed", "a test");
    for (const auto& recordings : {NuScenes(folder_ / "nuscenes"), Argoverse()}) {
      for (const v1::Scenario& recording : recordings) {
        const absl::Status status = (*writer)->Add(recording);
        EXPECT_TRUE(status.ok()) << status;
      }
    }
    EXPECT_TRUE((*writer)->Commit().ok());
  }
  std::vector<v1::Scenario> Recordings() const { return *ReadRecordings(folder_ / "mixed"); }

  const TemporaryFolder folder_;
};

TEST_F(MixedSourcesTest, EachFormatGivesExamplesOfItsVehicles) {
  std::map<std::string, std::set<int64_t>> targets;  // by the beginning of the id
  std::map<std::string, int> examples;
  for (const v1::Scenario& recording : Recordings()) {
    const std::string source = recording.scenario_id().substr(0, 3);
    for (const Example& example : EnumerateExamples(recording, 0, Spec(), Settings())) {
      targets[source].insert(example.target_id);
      ++examples[source];
      EXPECT_EQ(example.trajectory.size(), 60u);
    }
  }
  // Of each scene of 6 s: the recording car, the car and the turner at 1.0, 1.5, 2.0, 2.5 and 3.0 s.
  EXPECT_EQ(examples["n00"], kScenes * 3 * 5);
  EXPECT_EQ(targets["n00"].size(), 1u + 2u * kScenes);
  // Of each sequence of 4.9 s: AV and AGENT at 1.0 and 1.5 s. OTHERS give none.
  EXPECT_EQ(examples["PIT"], kSequences * 2 * 2);
  EXPECT_THAT(targets["PIT"], testing::UnorderedElementsAre(AgentId("av"), AgentId("agent")));
}

TEST_F(MixedSourcesTest, RecordingsOfOneDriveStayOnOneSideOfTheSplit) {
  std::map<std::string, std::set<bool>> sides;  // of each drive
  std::map<std::string, std::set<bool>> of_format;
  for (const v1::Scenario& recording : Recordings()) {
    const bool held_out = HeldOut(recording.scenario_id(), 0.4);
    sides[std::string(WithoutPart(recording.scenario_id()))].insert(held_out);
    of_format[recording.scenario_id().substr(0, 3)].insert(held_out);
  }
  EXPECT_EQ(sides.size(), kScenes / 2u + kSequences / 3u);
  for (const auto& [drive, side] : sides) EXPECT_EQ(side.size(), 1u) << drive;
  for (const auto& [format, side] : of_format) EXPECT_EQ(side.size(), 2u) << format;
}

TEST_F(MixedSourcesTest, CrossValidationKeepsADriveTogether) {
  RecordingGrouper grouper;
  for (v1::Scenario& recording : Recordings()) {
    // Only the ids may join them here: the toy scenes all show one drive.
    recording.clear_agents();
    grouper.Add(recording);
  }
  EXPECT_EQ(grouper.Groups().count, kScenes / 2 + kSequences / 3);
}

TEST_F(MixedSourcesTest, LabelsReachTheRecordingsOfEitherFormat) {
  const std::string csv =
      absl::StrCat("recording,target,time,action\nn001-a#scene-0001,",
                   AgentId(NuScenesFixture::Token("scene-0001/car")), ",2.0,keep_lane\nPIT-1000#0,",
                   AgentId("agent"), ",1.5,slow_down\n");
  const auto labels = CheckLabels(csv, folder_ / "mixed");
  ASSERT_TRUE(labels.ok()) << labels.status();
  ASSERT_EQ(labels->problem_count, 0) << labels->problems[0].what;
  ASSERT_TRUE(AnnotateDataset(folder_ / "mixed", labels->annotations, folder_ / "labelled").ok());
  std::vector<std::string> seen;
  ASSERT_TRUE(ForEachAnnotation(folder_ / "labelled", OnDamage::kStop,
                                [&](v1::ManeuverAnnotation&& annotation) {
                                  seen.push_back(annotation.scenario_id() + " " +
                                                 annotation.maneuver());
                                  return true;
                                })
                  .ok());
  EXPECT_THAT(seen, ElementsAre("n001-a#scene-0001 keep_lane", "PIT-1000#0 slow_down"));
}

}  // namespace
}  // namespace maneuver::data::mixed_sources_test
