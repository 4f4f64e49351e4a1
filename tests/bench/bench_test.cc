// Checks that maneuver-bench runs, on small measurements whose times are ignored, and that it
// measures what the engine does.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "tests/bench/answer_digest.h"
#include "tests/bench/bench_model.h"
#include "tests/bench/bench_report.h"
#include "tests/bench/bench_scenes.h"
#include "tests/bench/curves.h"
#include "tests/bench/interleaved.h"
#include "tests/bench/pipeline.h"
#include "tests/bench/precision_change.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::bench {
namespace {

namespace fs = std::filesystem;
using testing::ContainsRegex;
using testing::HasSubstr;
using testing::Not;

std::string Read(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

const BenchModel& Compact() {
  static const BenchModel model = PresetBenchModel("compact");
  return model;
}

TEST(BenchTest, ReportHasEveryStageTargetAndPicture) {
  const TemporaryFolder folder;
  fs::create_directories(folder / "pictures");
  ReportOptions options;
  options.models = {Compact()};
  options.scenes = {{"synthetic scenes", TownScenes(kLargestBatch, 2)}};
  options.seconds = 0.0;
  options.rounds = 1;
  options.most_targets = 16;
  options.yardstick_bytes = size_t{1} << 20;
  options.file = folder / "report.md";
  options.pictures = folder / "pictures";
  ASSERT_EQ(WriteReport(options), absl::OkStatus());

  const std::string report = Read(options.file);
  for (int stage = 0; stage < kStages; ++stage) {
    EXPECT_THAT(report,
                ContainsRegex(std::string("\n\\| ") +
                              StageName(static_cast<Stage>(stage), Compact().model->spec()) +
                              " \\| [0-9]+\\.?[0-9]* \\| [0-9.]+ % "));
  }
  for (const char* part :
       {"matrix product, f32", "matrix product, bf16", "memory, read", "memory, copied",
        "rasterise / backbone", "distributions of 4 actions / backbone",
        "other than raster and networks / sum of the stages", "| compact | 64x64x13 |"}) {
    EXPECT_THAT(report, HasSubstr(part));
  }
  EXPECT_THAT(report, ContainsRegex("\n\\| 1 \\| [0-9]+ \\| 1.000 "));  // workers
  EXPECT_THAT(report, Not(HasSubstr("nan")));
  EXPECT_THAT(report, Not(HasSubstr("inf ")));
  for (const char* picture : {"stages", "targets", "agents", "map", "actions"}) {
    const std::string name = std::string("pictures/performance-") + picture + ".svg";
    EXPECT_THAT(report, HasSubstr("](" + name + ")"));
    EXPECT_THAT(Read(folder / name), HasSubstr("</svg>"));
  }
}

// Uses random weights of the preset's size. The report has the changes of a trained model's
// answers.
TEST(BenchTest, Bf16StaysCloseToF32OnRecordedScenes) {
  if (!inference::ProcessorHasBf16()) GTEST_SKIP() << "this processor does not compute with bf16";
  const auto scenes = WaymoScenes(kLargestBatch, 12);
  if (scenes.empty()) GTEST_SKIP() << "MANEUVER_REAL_DATA is not set";
  const BenchModel model = WithPrecision(Compact(), inference::Precision::kBf16);
  const PrecisionChange change = ChangeFromF32(model, scenes);
  EXPECT_GE(change.targets, 8);
  EXPECT_GT(change.largest_probability, 0.0);  // or one was compared with itself
  EXPECT_LT(change.largest_probability, 0.02);
  EXPECT_LT(change.mean_probability, 0.002);
  EXPECT_LT(change.largest_waypoint, 0.5);
  EXPECT_LT(change.mean_waypoint, 0.05);
  EXPECT_EQ(
      ChangeFromF32(WithPrecision(model, inference::Precision::kF32), scenes).largest_probability,
      0.0);
}

// Small models that learned from the town's traffic.
TEST(BenchTest, Bf16StaysCloseToF32ForTrainedLanes) {
  if (!inference::ProcessorHasBf16()) GTEST_SKIP() << "this processor does not compute with bf16";
  std::vector<v1::Scenario> scenes = TownScenes(kLargestBatch, 12);
  for (v1::Scenario& scene : WaymoScenes(kLargestBatch, 12)) scenes.push_back(std::move(scene));
  for (const char* name : {"2026-11-lanes", "2026-11-lanes-agents"}) {
    const auto trained = FolderBenchModel(fs::path(EARLIER_MODELS) / name);
    ASSERT_TRUE(trained.ok()) << trained.status();
    const PrecisionChange change =
        ChangeFromF32(WithPrecision(*trained, inference::Precision::kBf16), scenes);
    EXPECT_GE(change.targets, 40) << name;
    EXPECT_GT(change.largest_probability, 0.0) << name;  // or one was compared with itself
    EXPECT_LT(change.largest_probability, 0.01) << name;
    EXPECT_LT(change.mean_probability, 0.001) << name;
  }
}

class PipelineTest : public testing::TestWithParam<const char*> {};

// Otherwise the bench would measure another backbone and other heads than the server uses.
TEST_P(PipelineTest, SeparateStagesGiveTheResponseOfTheWholeCall) {
  const auto scenes = TownScenes(kLargestBatch, 1);
  ASSERT_EQ(scenes.size(), 1u);
  const BenchModel model = PresetBenchModel(GetParam());
  Pipeline pipeline(model, {RequestFor(scenes, 4)}, 4);
  ASSERT_EQ(pipeline.targets(), kLargestBatch);
  pipeline.RunAll();
  const std::string together = pipeline.responses().front();
  const auto probabilities = pipeline.encodings().back().probabilities;
  for (int stage = 0; stage < kStages; ++stage) pipeline.Run(static_cast<Stage>(stage));
  EXPECT_EQ(pipeline.responses().front(), together);
  EXPECT_EQ(pipeline.encodings().back().probabilities, probabilities);
  v1::PredictResponse response;
  ASSERT_TRUE(response.ParseFromString(together));
  ASSERT_EQ(response.predictions(0).targets_size(), kLargestBatch);
  EXPECT_EQ(response.predictions(0).targets(0).distributions_size(), 4);
}

INSTANTIATE_TEST_SUITE_P(Presets, PipelineTest, testing::Values("compact", kLanes));

TEST(BenchTest, DescribesRepresentativesInsteadOfTheMostProbableActions) {
  const auto scenes = TownScenes(1, 1);
  ASSERT_EQ(scenes.size(), 1u);
  Pipeline pipeline(Compact(), {RequestFor(scenes, 0)}, 0, 6);
  v1::PredictResponse response;
  ASSERT_TRUE(response.ParseFromString(pipeline.responses().front()));
  EXPECT_EQ(response.predictions(0).targets(0).representatives_size(), 6);
  EXPECT_EQ(response.predictions(0).targets(0).distributions_size(), 6);
}

TEST(BenchTest, CombinesTheActionsOfTheTargets) {
  const auto scenes = TownScenes(4, 1);
  ASSERT_EQ(scenes.size(), 1u);
  Pipeline pipeline(Compact(), {RequestFor(scenes, 2)}, 2, 0, 6);
  v1::PredictResponse response;
  ASSERT_TRUE(response.ParseFromString(pipeline.responses().front()));
  EXPECT_EQ(response.predictions(0).joint().target_ids_size(), 4);
  EXPECT_LE(response.predictions(0).joint().combinations_size(), 6);
}

TEST(BenchTest, DigestTellsWhetherAnyAnswerChanged) {
  auto scenes = TownScenes(2, 2);
  ASSERT_EQ(scenes.size(), 2u);
  const std::string digest = AnswerDigest(Compact(), scenes);
  EXPECT_EQ(digest.size(), 64u);
  EXPECT_EQ(AnswerDigest(Compact(), scenes), digest);
  scenes[1].mutable_target_ids()->SwapElements(0, 1);
  EXPECT_NE(AnswerDigest(Compact(), scenes), digest);
}

TEST(BenchTest, LargerScenesDifferOnlyInAgentsAndMapPoints) {
  const auto scenes = TownScenes(kLargestBatch, 1);
  ASSERT_EQ(scenes.size(), 1u);
  const v1::Scenario crowded = WithAgents(scenes[0], 300);
  EXPECT_EQ(crowded.agents_size(), kLargestBatch + 300);
  EXPECT_EQ(MapPoints(crowded), MapPoints(scenes[0]));
  EXPECT_EQ(Pipeline(Compact(), {RequestFor({crowded}, 1)}, 1).targets(), kLargestBatch);
  const v1::Scenario vast = WithMapPoints(scenes[0], 3 * MapPoints(scenes[0]));
  EXPECT_GE(MapPoints(vast), 3 * MapPoints(scenes[0]));
  EXPECT_EQ(vast.agents_size(), scenes[0].agents_size());
  EXPECT_EQ(MapPoints(WithMapCopies(scenes[0], 3)), 3 * MapPoints(scenes[0]));
  EXPECT_EQ(Pipeline(Compact(), {RequestFor({vast}, 1)}, 1).targets(), kLargestBatch);
}

TEST(BenchTest, RatiosCompareMeasurementsOfOneRound) {
  // The machine is ten times slower in one round: the ratio of medians would be 1.5.
  const Series a = {2, 20, 2};
  const Series b = {1, 10, 1};
  EXPECT_EQ(Median(Ratios(a, b)), 2.0);
  EXPECT_EQ(Median({5, 1, 3}), 3.0);
  EXPECT_EQ(Quantile({4, 3, 2, 1, 0}, 0.25), 1.0);
}

TEST(BenchTest, FitsALineAndReportsTheLargestDeviation) {
  const StraightLine exact = FitLine({0, 1, 3}, {5, 7, 11});
  EXPECT_NEAR(exact.constant, 5.0, 1e-12);
  EXPECT_NEAR(exact.slope, 2.0, 1e-12);
  EXPECT_NEAR(exact.furthest, 0.0, 1e-12);
  // By hand: the line through (0, 1), (1, 4), (2, 1) is y = 2.
  const StraightLine bent = FitLine({0, 1, 2}, {1, 4, 1});
  EXPECT_NEAR(bent.constant, 2.0, 1e-12);
  EXPECT_NEAR(bent.slope, 0.0, 1e-12);
  EXPECT_NEAR(bent.furthest, 1.0, 1e-12);
}

}  // namespace
}  // namespace maneuver::bench
