// Reads real recordings, if they are available: MANEUVER_REAL_DATA names the folder of the unpacked
// Waymo archive, or its parent.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "model/data/example_index.h"
#include "model/data/tfrecord.h"
#include "model/data/waymo/waymo_reader.h"
#include "model/scene/scenario_validation.h"

namespace maneuver::data::real_recordings_test {
namespace {

std::vector<std::filesystem::path> RecordFiles(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> found;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::string name = entry.path().filename();
    for (const char* part : {"training", "validation", "original"}) {
      if (name.starts_with(std::string(part) + ".tfrecord")) found.push_back(entry.path());
    }
  }
  std::sort(found.begin(), found.end());
  return found;
}

TEST(RealRecordingsTest, EveryWaymoScenarioIsValidAndGivesExamples) {
  const char* folder = std::getenv("MANEUVER_REAL_DATA");
  if (folder == nullptr || *folder == '\0') {
    GTEST_SKIP() << "MANEUVER_REAL_DATA is not set: no real recordings to read";
  }
  const auto record_files = RecordFiles(folder);
  ASSERT_FALSE(record_files.empty()) << "no .tfrecord file in the folder of MANEUVER_REAL_DATA";

  v1::ModelSpec spec;  // one second back, five ahead at 10 Hz
  spec.mutable_raster()->set_history_frames(11);
  spec.mutable_raster()->mutable_frame_interval()->set_nanos(100'000'000);
  spec.mutable_trajectory()->set_waypoints(50);
  spec.mutable_trajectory()->mutable_waypoint_interval()->set_nanos(100'000'000);
  v1::ExampleSettings settings;
  settings.mutable_stride()->set_nanos(500'000'000);
  settings.set_keep_standing(1.0);
  settings.set_standing_distance(1.0);
  settings.set_max_speed(45.0);

  int64_t scenarios = 0;
  int64_t examples = 0;
  int64_t standing = 0;
  for (const auto& file : record_files) {
    auto reader = TfRecordReader::Open(file);
    ASSERT_TRUE(reader.ok()) << reader.status();
    std::string payload;
    for (;;) {
      const absl::Status status = (*reader)->Next(&payload);
      if (absl::IsOutOfRange(status)) break;
      ASSERT_TRUE(status.ok()) << status;
      const auto scenario = ParseWaymoScenario(payload);
      ASSERT_TRUE(scenario.ok()) << scenario.status();
      const auto violations = scene::ValidateScenario(*scenario, {});
      EXPECT_TRUE(violations.empty()) << scenario->scenario_id() << ": " << violations.front().field
                                      << " " << violations.front().description;
      for (int i = 0; i < scenario->target_ids_size(); ++i) {
        EXPECT_FALSE(scene::ValidateTarget(*scenario, i, 0.05)) << scenario->scenario_id();
      }
      ++scenarios;
      examples +=
          static_cast<int64_t>(EnumerateExamples(*scenario, 0, spec, settings, &standing).size());
    }
  }
  RecordProperty("scenarios", static_cast<int>(scenarios));
  RecordProperty("examples", static_cast<int>(examples));
  EXPECT_GT(examples, scenarios);
  // About 70 % of Waymo's vehicle windows stand still.
  EXPECT_NEAR(static_cast<double>(standing) / static_cast<double>(examples), 0.7, 0.1);
}

}  // namespace
}  // namespace maneuver::data::real_recordings_test
