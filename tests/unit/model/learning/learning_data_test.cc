// What learning does without LibTorch: the split, the loader, the clusters, the progress.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <set>

#include "model/learning/raster_loader.h"
#include "model/learning/run_progress.h"
#include "model/learning/training_data.h"
#include "model/learning/trajectory_clusters.h"
#include "model/scene/rasterizer.h"
#include "tests/unit/model/learning/analytic_scenes.h"

namespace maneuver::learning {
namespace {

using testing::HasSubstr;

TEST(TrainingDataTest, HoldsOutWholeRecordings) {
  const auto data = SplitRecordings(ArcRecordings(60), TinySettings());
  ASSERT_TRUE(data.ok());
  ASSERT_FALSE(data->validation.recordings.empty());
  std::set<std::string> training;
  for (const v1::Scenario& recording : data->training.recordings) {
    training.insert(recording.scenario_id());
  }
  for (const v1::Scenario& recording : data->validation.recordings) {
    EXPECT_EQ(training.count(recording.scenario_id()), 0u);
  }
  EXPECT_EQ(training.size() + data->validation.recordings.size(), 60u);
}

TEST(TrainingDataTest, TooFewExamplesAreRefusedWithWhatWasFoundAndWhatToDo) {
  const auto data = SplitRecordings(ArcRecordings(2), TinySettings());
  ASSERT_EQ(data.status().code(), absl::StatusCode::kFailedPrecondition);
  const std::string message(data.status().message());
  EXPECT_THAT(message, HasSubstr("2 recordings hold"));
  EXPECT_THAT(message, HasSubstr("32 are needed"));
  EXPECT_THAT(message, HasSubstr("3.0 s of future"));
  EXPECT_THAT(message, HasSubstr("Add recordings"));
}

TEST(VariationTest, IsAFunctionOfSeedEpochAndExample) {
  const v1::AugmentationSettings settings = TinySettings().augmentation();
  const Variation once = DrawVariation(settings, 1, 2, 3);
  const Variation again = DrawVariation(settings, 1, 2, 3);
  EXPECT_EQ(once.scale, again.scale);
  EXPECT_NE(once.scale, DrawVariation(settings, 2, 2, 3).scale);
  EXPECT_NE(once.scale, DrawVariation(settings, 1, 3, 3).scale);
  EXPECT_NE(once.scale, DrawVariation(settings, 1, 2, 4).scale);
}

TEST(VariationTest, StaysInItsLimitsAndMirrorsHalf) {
  const v1::AugmentationSettings settings = TinySettings().augmentation();
  int mirrored = 0;
  for (int i = 0; i < 2000; ++i) {
    const Variation variation = DrawVariation(settings, 1, 1, i);
    mirrored += variation.mirror;
    EXPECT_LE(std::abs(variation.scale - 1.0), settings.scale());
    EXPECT_LE(std::abs(variation.shift_x), settings.shift_pixels());
  }
  EXPECT_NEAR(mirrored, 1000, 100);
}

// The trajectory of a varied example is where the varied raster shows it.
TEST(VariationTest, RasterAndTrajectoryAreVariedAlike) {
  // A left arc varied by a mirror alone looks like the right arc, and goes where that goes.
  ExampleSet left, right;
  const v1::TrainingSettings settings = TinySettings();
  for (auto [set, curvature] : {std::pair(&left, 0.05), std::pair(&right, -0.05)}) {
    set->recordings.push_back(ArcRecording("arc", curvature, 10.0));
    set->examples =
        data::EnumerateExamples(set->recordings[0], 0, settings.model(), settings.examples());
    ASSERT_FALSE(set->examples.empty());
  }
  Variation mirror;
  mirror.mirror = true;
  const v1::RasterSpec& spec = settings.model().raster();
  const auto mirrored = RasterLoader(spec, left, {{0, mirror}}, 1, 1).Next();
  const auto plain = RasterLoader(spec, right, {{0, {}}}, 1, 1).Next();
  ASSERT_TRUE(mirrored && plain);
  int difference = 0;
  for (size_t i = 0; i < plain->rasters.size(); ++i) {
    difference = std::max(difference, std::abs(mirrored->rasters[i] - plain->rasters[i]));
  }
  EXPECT_LE(difference, 2);
  std::vector<float> trajectory = left.examples[0].trajectory;
  ApplyVariation(mirror, trajectory);
  for (size_t i = 0; i < trajectory.size(); ++i) {
    EXPECT_NEAR(trajectory[i], right.examples[0].trajectory[i], 1e-3);
  }
}

TEST(RasterLoaderTest, BatchesComeInOrderWhateverTheNumberOfThreads) {
  const auto data = SplitRecordings(ArcRecordings(60), TinySettings());
  ASSERT_TRUE(data.ok());
  std::vector<RasterLoader::Item> items;
  for (int64_t i = 0; i < 45; ++i) {
    items.push_back({(i * 7) % 60, DrawVariation(TinySettings().augmentation(), 1, 1, i)});
  }
  const v1::RasterSpec spec = TinySettings().model().raster();
  RasterLoader one(spec, data->training, items, 4, 1);
  RasterLoader three(spec, data->training, items, 4, 3);
  size_t seen = 0;
  while (auto batch = one.Next()) {
    const auto other = three.Next();
    ASSERT_TRUE(other);
    EXPECT_EQ(batch->rasters, other->rasters);
    for (const RasterLoader::Item& item : batch->items) {
      EXPECT_EQ(item.example, items[seen++].example);
    }
  }
  EXPECT_EQ(seen, items.size());
  EXPECT_FALSE(three.Next());
}

TEST(RasterLoaderTest, CanBeLeftBeforeThePassIsOver) {
  const auto data = SplitRecordings(ArcRecordings(60), TinySettings());
  ASSERT_TRUE(data.ok());
  RasterLoader loader(TinySettings().model().raster(), data->training,
                      std::vector<RasterLoader::Item>(400), 4, 2);
  EXPECT_TRUE(loader.Next());
}

TEST(TrajectoryClustersTest, FindsSeparateGroups) {
  constexpr int kGroups = 4;
  constexpr int kEach = 25;
  TrajectoryRows rows(kGroups * kEach, 4);
  for (int i = 0; i < rows.rows(); ++i) {
    const int group = i % kGroups;
    rows.row(i).setConstant(static_cast<float>(20 * group));
    rows(i, i % 4) += 0.01F * static_cast<float>(i);
  }
  const TrajectoryClusters clusters = ClusterTrajectories(rows, kGroups, 1, 3);
  std::set<int> used;
  for (int i = 0; i < rows.rows(); ++i) {
    EXPECT_EQ(clusters.assignment[i], clusters.assignment[i % kGroups]);
    used.insert(clusters.assignment[i]);
  }
  EXPECT_EQ(used.size(), static_cast<size_t>(kGroups));
}

TEST(TrajectoryClustersTest, CentresAreMeansAndInertiaIsTheSumOfSquares) {
  const TrajectoryRows rows = TrajectoryRows::Random(60, 6);
  const TrajectoryClusters clusters = ClusterTrajectories(rows, 5, 2, 2);
  Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(5, 6);
  Eigen::VectorXd counts = Eigen::VectorXd::Zero(5);
  double inertia = 0.0;
  for (int i = 0; i < rows.rows(); ++i) {
    const int k = clusters.assignment[i];
    sums.row(k) += rows.row(i).cast<double>();
    counts[k] += 1.0;
    inertia += (rows.row(i) - clusters.centers.row(k)).squaredNorm();
  }
  for (int k = 0; k < 5; ++k) {
    ASSERT_GT(counts[k], 0.0);
    EXPECT_LT((sums.row(k) / counts[k] - clusters.centers.row(k).cast<double>()).norm(), 1e-3);
  }
  EXPECT_NEAR(clusters.inertia, inertia, 1e-3);
}

class RunProgressTest : public testing::Test {
 protected:
  std::chrono::system_clock::time_point now_{std::chrono::seconds(1000)};
  std::vector<v1::JobProgress> seen_;
  RunProgress progress_{{{"load", 1, 1, 1.0}, {"pretrain", 2, 10, 1.0}, {"joint", 2, 10, 9.0}},
                        [this](const v1::JobProgress& each) { seen_.push_back(each); },
                        [this] { return now_; }};
};

TEST_F(RunProgressTest, FractionWeighsStepsByTheirCostAndTimeLeftFollows) {
  progress_.BeginPhase("pretrain");
  now_ += std::chrono::seconds(1);
  for (int i = 0; i < 10; ++i) progress_.Step(4);
  now_ += std::chrono::seconds(10);
  progress_.BeginPhase("joint");
  EXPECT_NEAR(seen_.back().fraction(), 11.0 / 101.0, 1e-9);
  EXPECT_EQ(seen_.back().time_left().seconds(), 90);
}

TEST_F(RunProgressTest, ReportsAFewTimesASecondAndEachEpoch) {
  progress_.BeginPhase("pretrain");
  const size_t before = seen_.size();
  for (int i = 0; i < 5; ++i) progress_.Step(4);
  EXPECT_EQ(seen_.size(), before);
  now_ += std::chrono::seconds(1);
  progress_.Step(4);
  EXPECT_EQ(seen_.size(), before + 1);
  v1::EpochReport report;
  report.set_effective_actions(5);
  progress_.EndEpoch(report);
  EXPECT_EQ(seen_.back().epoch_report().effective_actions(), 5);
  for (size_t i = 0; i < seen_.size(); ++i) {
    EXPECT_EQ(seen_[i].sequence(), static_cast<int64_t>(i) + 1);
  }
}

}  // namespace
}  // namespace maneuver::learning
