// Compares DescribeDataset with counts made by hand.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <numbers>
#include <string>

#include "model/data/dataset_folder.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::data::dataset_description_test {
namespace {

// One second of past, two of future.
v1::ModelSpec Spec() {
  v1::ModelSpec spec;
  spec.mutable_raster()->set_history_frames(11);
  spec.mutable_raster()->mutable_frame_interval()->set_nanos(100'000'000);
  spec.mutable_trajectory()->set_waypoints(4);
  spec.mutable_trajectory()->mutable_waypoint_interval()->set_nanos(500'000'000);
  return spec;
}

// One example per second: a vehicle present from 0 to 5 s has examples at 1, 2 and 3 s.
v1::ExampleSettings Settings() {
  v1::ExampleSettings settings;
  settings.mutable_stride()->set_seconds(1);
  settings.set_keep_standing(0.1);
  settings.set_standing_distance(1.0);
  settings.set_max_speed(45.0);
  return settings;
}

// Returns how many of a histogram's values are in the bin that contains `value`.
int64_t CountAt(const v1::Histogram& histogram, double value) {
  for (int i = 0; i < histogram.counts_size(); ++i) {
    if (value >= histogram.edges(i) && value < histogram.edges(i + 1)) return histogram.counts(i);
  }
  return -1;
}

int64_t SumOf(const v1::Histogram& histogram) {
  int64_t sum = 0;
  for (const int64_t count : histogram.counts()) sum += count;
  return sum;
}

// Four recordings, each with a vehicle that has three examples: one drives at 10 m/s along the
// lane, one stands on it, one drives at 10 m/s beside it (20 m away) and turns left by 0.2 rad per
// second, and one is in a recording without a map.
class DatasetDescriptionTest : public testing::Test {
 protected:
  DatasetDescriptionTest() {
    auto writer = DatasetWriter::Create(folder_ / "town", "a test", {.shard_bytes = 3'000});
    EXPECT_TRUE((*writer)->Add(SmallRecording("drives")).ok());
    EXPECT_TRUE((*writer)->Add(SmallRecording("stands", 0.0)).ok());
    v1::Scenario turns = SmallRecording("turns");
    for (v1::AgentState& state : *turns.mutable_agents(0)->mutable_states()) {
      state.set_y(20.0);
      // Passes pi on the way.
      const double heading = std::numbers::pi - 0.6 + 0.2 * state.time();
      state.set_heading(std::remainder(heading, 2.0 * std::numbers::pi));
    }
    EXPECT_TRUE((*writer)->Add(turns).ok());
    v1::Scenario bare = SmallRecording("bare");
    bare.clear_map_features();
    EXPECT_TRUE((*writer)->Add(bare).ok());
    v1::ManeuverAnnotation annotation;
    annotation.set_scenario_id("turns");
    annotation.set_maneuver("turn_left");
    EXPECT_TRUE((*writer)->Add(annotation).ok());
    EXPECT_TRUE((*writer)->Commit().ok());
  }

  v1::DatasetSummary Describe(int threads = 0) const {
    const auto summary = DescribeDataset(folder_ / "town", Spec(), Settings(), threads);
    EXPECT_TRUE(summary.ok()) << summary.status();
    return *summary;
  }

  const TemporaryFolder folder_;
};

TEST_F(DatasetDescriptionTest, CountsExamplesAndStandingOnes) {
  const v1::DatasetSummary summary = Describe();
  EXPECT_EQ(summary.dataset().recordings(), 4);
  EXPECT_DOUBLE_EQ(summary.dataset().duration_seconds(), 20.0);
  EXPECT_EQ(summary.agents_by_type().at("VEHICLE"), 4);
  EXPECT_EQ(summary.agents_by_type().at("PEDESTRIAN"), 4);
  EXPECT_EQ(summary.map_features_by_type().at("LANE_CENTERLINE"), 3);
  EXPECT_EQ(summary.maneuvers().at("turn_left"), 1);
  EXPECT_EQ(summary.examples(), 12);
  EXPECT_EQ(summary.standing_examples(), 3);
  EXPECT_EQ(summary.standing_vehicles(), 1);
  EXPECT_DOUBLE_EQ(summary.horizon_seconds(), 2.0);
  EXPECT_EQ(summary.example_settings().SerializeAsString(), Settings().SerializeAsString());
}

TEST_F(DatasetDescriptionTest, EndsBeforeTheNextRecordingOnceItIsGivenUp) {
  int asked = 0;
  const auto summary = DescribeDataset(folder_ / "town", Spec(), Settings(), /*threads=*/1,
                                       [&asked] { return ++asked == 2; });
  EXPECT_TRUE(absl::IsCancelled(summary.status())) << summary.status();
  EXPECT_EQ(asked, 2);
}

TEST_F(DatasetDescriptionTest, CountsExamplesOfEveryTypeAndDescribesVehicles) {
  const v1::DatasetSummary summary = Describe();
  EXPECT_EQ(summary.examples_by_type().at("VEHICLE"), summary.examples());
  // Equally many pedestrians as vehicles, present for as long; they stand.
  EXPECT_EQ(summary.examples_by_type().at("PEDESTRIAN"), 12);
  EXPECT_EQ(summary.examples_by_type().size(), 2u);
}

TEST_F(DatasetDescriptionTest, CountsSpeedsOfAllExamples) {
  const v1::Histogram speeds = Describe().speeds();
  EXPECT_EQ(CountAt(speeds, 0.0), 3);
  // 10 m/s is the boundary of two bins.
  EXPECT_EQ(CountAt(speeds, 9.9) + CountAt(speeds, 10.1), 9);
  EXPECT_EQ(SumOf(speeds), 12);
}

TEST_F(DatasetDescriptionTest, CountsTurnsOfMovingTargetsByTheirWrappedAngle) {
  const v1::Histogram turns = Describe().turns();
  EXPECT_EQ(CountAt(turns, 0.0), 6);
  // Two seconds at 0.2 rad per second.
  EXPECT_EQ(CountAt(turns, 0.4), 3);
  EXPECT_EQ(SumOf(turns), 9);
}

TEST_F(DatasetDescriptionTest, MeasuresTheMapCoverage) {
  const v1::MapCoverage coverage = Describe().map_coverage();
  EXPECT_EQ(coverage.recordings_with_lanes(), 3);
  EXPECT_DOUBLE_EQ(coverage.lane_length(), 300.0);
  // Those of the vehicle that drives on the lane and of the one that stands on it.
  EXPECT_EQ(coverage.examples_on_lanes(), 6);
}

TEST_F(DatasetDescriptionTest, CountsTheSameOnAnyNumberOfThreads) {
  const v1::DatasetSummary one = Describe(1);
  for (const int threads : {2, 3, 16}) {
    const v1::DatasetSummary several = Describe(threads);
    EXPECT_EQ(several.DebugString(), one.DebugString()) << threads;
  }
}

TEST_F(DatasetDescriptionTest, ReportsADamagedRecordOnAnyNumberOfThreads) {
  const auto manifest = ReadDatasetManifest(folder_ / "town");
  std::filesystem::resize_file(folder_ / "town" / manifest->shards(0).file(), 100);
  for (const int threads : {1, 3}) {
    EXPECT_TRUE(
        absl::IsDataLoss(DescribeDataset(folder_ / "town", Spec(), Settings(), threads).status()));
  }
}

}  // namespace
}  // namespace maneuver::data::dataset_description_test
