// What learning does without LibTorch: the split, the loader, the clusters, the progress.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <set>
#include <thread>

#include "model/learning/scene_loader.h"
#include "model/learning/training_data.h"
#include "model/learning/training_progress.h"
#include "model/learning/trajectory_clusters.h"
#include "model/scene/rasterizer.h"
#include "tests/unit/model/learning/analytic_scenes.h"

namespace maneuver::learning::learning_data_test {
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

// The examples of a set that EnumerateExamples finds at a stride.
std::vector<double> TimesAtStride(const ExampleSet& set, const v1::TrainingSettings& settings,
                                  int milliseconds) {
  v1::ExampleSettings examples = settings.examples();
  examples.clear_training_stride();
  examples.mutable_stride()->set_seconds(0);
  examples.mutable_stride()->set_nanos(1'000'000 * milliseconds);
  std::vector<double> times;
  for (const v1::Scenario& recording : set.recordings) {
    for (const data::Example& example :
         data::EnumerateExamples(recording, 0, settings.model(), examples)) {
      times.push_back(example.time);
    }
  }
  return times;
}

std::vector<double> Times(const ExampleSet& set) {
  std::vector<double> times;
  for (const data::Example& example : set.examples) times.push_back(example.time);
  return times;
}

std::vector<std::string> Ids(const ExampleSet& set) {
  std::vector<std::string> ids;
  for (const v1::Scenario& recording : set.recordings) ids.push_back(recording.scenario_id());
  return ids;
}

TEST(TrainingDataTest, TheTrainingStrideIsThatOfTrainingExamplesAlone) {
  for (v1::TrainingSettings settings : {TinySettings(), TinyLanesSettings()}) {
    settings.mutable_examples()->mutable_stride()->set_seconds(0);
    settings.mutable_examples()->mutable_stride()->set_nanos(500'000'000);
    settings.mutable_examples()->clear_training_stride();
    const auto without = SplitRecordings(ArcRecordings(24), settings);
    settings.mutable_examples()->mutable_training_stride()->set_nanos(200'000'000);
    const auto with = SplitRecordings(ArcRecordings(24), settings);
    ASSERT_TRUE(without.ok() && with.ok());
    // The same recordings are held out, at the same times.
    EXPECT_EQ(Ids(with->training), Ids(without->training));
    EXPECT_EQ(Ids(with->validation), Ids(without->validation));
    ASSERT_FALSE(with->validation.examples.empty());
    EXPECT_EQ(Times(with->validation), Times(without->validation));
    EXPECT_EQ(Times(with->validation), TimesAtStride(with->validation, settings, 500));
    // Training examples are those of the other stride, and without one those of the same.
    EXPECT_EQ(Times(without->training), TimesAtStride(without->training, settings, 500));
    EXPECT_EQ(Times(with->training), TimesAtStride(with->training, settings, 200));
    EXPECT_GT(with->training.examples.size(), 2 * without->training.examples.size());
    // Two examples of one target are a fifth of a second apart.
    const std::vector<data::Example>& examples = with->training.examples;
    for (size_t i = 1; i < examples.size(); ++i) {
      if (examples[i].recording != examples[i - 1].recording) continue;
      EXPECT_NEAR(examples[i].time - examples[i - 1].time, 0.2, 1e-6);
    }
  }
}

TEST(TrainingDataTest, RefusesTooFewExamplesAndSaysWhatToDo) {
  const auto data = SplitRecordings(ArcRecordings(2), TinySettings());
  ASSERT_EQ(data.status().code(), absl::StatusCode::kFailedPrecondition);
  const std::string message(data.status().message());
  EXPECT_THAT(message, HasSubstr("2 recordings with 2 vehicles hold"));
  EXPECT_THAT(message, HasSubstr("32 are needed"));
  EXPECT_THAT(message, HasSubstr("3.0 s of future"));
  EXPECT_THAT(message, HasSubstr("Add recordings"));
}

TEST(TrainingDataTest, RefusesRecordingsWithoutATarget) {
  v1::TrainingSettings settings = TinySettings();
  settings.mutable_model()->add_target_types(v1::AGENT_TYPE_CYCLIST);
  const auto data = SplitRecordings(ArcRecordings(20), settings);
  ASSERT_EQ(data.status().code(), absl::StatusCode::kFailedPrecondition);
  const std::string message(data.status().message());
  EXPECT_THAT(message, HasSubstr("20 recordings with 0 cyclists hold 0 training examples"));
  EXPECT_THAT(message, HasSubstr("check model.target_types"));
}

TEST(VariationTest, IsAFunctionOfSeedEpochAndExample) {
  const v1::AugmentationSettings settings = TinySettings().augmentation();
  const Variation once = DrawVariation(settings, 5, 1, 2, 3);
  const Variation again = DrawVariation(settings, 5, 1, 2, 3);
  EXPECT_EQ(once.scale, again.scale);
  EXPECT_NE(once.scale, DrawVariation(settings, 5, 2, 2, 3).scale);
  EXPECT_NE(once.scale, DrawVariation(settings, 5, 1, 3, 3).scale);
  EXPECT_NE(once.scale, DrawVariation(settings, 5, 1, 2, 4).scale);
}

TEST(VariationTest, StaysWithinItsLimitsAndMirrorsHalf) {
  const v1::AugmentationSettings settings = TinySettings().augmentation();
  int mirrored = 0;
  for (int i = 0; i < 2000; ++i) {
    const Variation variation = DrawVariation(settings, 5, 1, 1, i);
    mirrored += variation.mirror;
    EXPECT_LE(std::abs(variation.scale - 1.0), settings.scale());
    EXPECT_LE(std::abs(variation.shift_x), settings.shift_pixels());
  }
  EXPECT_NEAR(mirrored, 1000, 100);
}

// The trajectory of a varied example is where the varied raster shows it.
TEST(VariationTest, RasterAndTrajectoryShareOneVariation) {
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
  const v1::ModelSpec& spec = settings.model();
  const auto mirrored = SceneLoader(spec, SceneSource(spec, left, 1), {{0, mirror}}, 1, 1).Next();
  const auto plain = SceneLoader(spec, SceneSource(spec, right, 1), {{0, {}}}, 1, 1).Next();
  ASSERT_TRUE(mirrored && plain);
  const at::Tensor difference =
      mirrored->scenes.rasters.Dense().to(at::kInt) - plain->scenes.rasters.Dense().to(at::kInt);
  EXPECT_LE(difference.abs().max().item<int>(), 2);
  std::vector<float> trajectory = left.examples[0].trajectory;
  ApplyVariation(mirror, trajectory);
  for (size_t i = 0; i < trajectory.size(); ++i) {
    EXPECT_NEAR(trajectory[i], right.examples[0].trajectory[i], 1e-3);
  }
}

// Turning the target's frame by an angle is turning the world by its opposite.
TEST(VariationTest, RotationTurnsRasterAndTrajectoryTogether) {
  constexpr double kAngle = 0.3;
  const v1::TrainingSettings settings = TinySettings();
  ExampleSet plain, turned;
  plain.recordings.push_back(ArcRecording("arc", 0.05, 10.0));
  turned.recordings.push_back(plain.recordings[0]);
  for (ExampleSet* set : {&plain, &turned}) {
    set->examples =
        data::EnumerateExamples(set->recordings[0], 0, settings.model(), settings.examples());
  }
  data::Example& by_hand = turned.examples[0];
  by_hand.X_WT = scene::Pose2(by_hand.X_WT.x(), by_hand.X_WT.y(), by_hand.X_WT.heading() + kAngle);
  Variation rotation;
  rotation.rotation = kAngle;
  const v1::ModelSpec& spec = settings.model();
  const auto varied = SceneLoader(spec, SceneSource(spec, plain, 1), {{0, rotation}}, 1, 1).Next();
  const auto expected = SceneLoader(spec, SceneSource(spec, turned, 1), {{0, {}}}, 1, 1).Next();
  ASSERT_TRUE(varied && expected);
  EXPECT_TRUE(varied->scenes.rasters.Dense().equal(expected->scenes.rasters.Dense()));

  std::vector<float> trajectory = plain.examples[0].trajectory;
  ApplyVariation(rotation, trajectory);
  const data::Example& original = plain.examples[0];
  for (size_t i = 0; i < trajectory.size(); i += 2) {
    const scene::Point2 p_W =
        original.X_WT * scene::Point2{original.trajectory[i], original.trajectory[i + 1]};
    const scene::Point2 p_T = by_hand.X_WT.ToLocal(p_W);
    EXPECT_NEAR(trajectory[i], p_T.x, 1e-4);
    EXPECT_NEAR(trajectory[i + 1], p_T.y, 1e-4);
  }
}

TEST(VariationTest, DropsAgentsAndFramesAtTheirShares) {
  v1::AugmentationSettings settings = TinySettings().augmentation();
  settings.set_drop_agents(0.25);
  settings.set_drop_history(0.5);
  settings.set_rotation(0.1);
  int shortened = 0;
  std::set<uint64_t> seeds;
  for (int i = 0; i < 2000; ++i) {
    const Variation variation = DrawVariation(settings, 5, 1, 1, i);
    EXPECT_EQ(variation.drop_agents, 0.25);
    EXPECT_LE(std::abs(variation.rotation), 0.1);
    seeds.insert(variation.drop_seed);
    if (variation.frames < 5) ++shortened;
    EXPECT_GE(variation.frames, 1);
  }
  EXPECT_EQ(seeds.size(), 2000u);
  EXPECT_NEAR(shortened, 800, 100);  // half of them, one in five of which keeps all five frames
}

TEST(VariationTest, MotionAndTrajectoryShareOneVariation) {
  Variation variation;
  variation.scale = 1.1;
  variation.mirror = true;
  const scene::MotionInputs varied = VariedMotion(variation, {1.0F, 0.5F, -0.5F, 0.2F});
  EXPECT_FLOAT_EQ(varied[0], 1.1F);
  EXPECT_FLOAT_EQ(varied[1], 0.55F);
  EXPECT_FLOAT_EQ(varied[2], -0.55F);
  EXPECT_FLOAT_EQ(varied[3], -0.2F);
}

TEST(SceneLoaderTest, AVariationHidesItsShareOfTheOtherAgents) {
  ExampleSet set;
  const v1::TrainingSettings settings = TinySettings();
  set.recordings.push_back(ArcRecording("arc", 0.0, 10.0));
  v1::Scenario& recording = set.recordings[0];
  for (int id = 2; id < 202; ++id) {
    v1::Agent& agent = *recording.add_agents();
    agent = recording.agents(0);
    agent.set_id(id);
    agent.set_type(v1::AGENT_TYPE_PEDESTRIAN);
    for (v1::AgentState& state : *agent.mutable_states()) {
      state.set_y(-20.0 + 0.2 * id);
      state.set_heading(0.0F);
    }
  }
  set.examples = data::EnumerateExamples(recording, 0, settings.model(), settings.examples());
  const v1::RasterSpec& spec = settings.model().raster();
  const SceneSource source(settings.model(), set, 1);
  const auto brightness = [&](const Variation& variation, int channel) {
    const auto batch = SceneLoader(settings.model(), source, {{0, variation}}, 1, 1).Next();
    return batch->scenes.rasters.Dense().select(3, channel).to(at::kLong).sum().item<int64_t>();
  };
  const int others = scene::OtherAgentsChannel(spec);
  Variation none, all, present;
  all.drop_agents = 0.999999;
  present.frames = 1;
  EXPECT_GT(brightness(none, others), 0);
  EXPECT_EQ(brightness(all, others), 0);
  EXPECT_EQ(brightness(all, scene::kTargetChannel), brightness(none, scene::kTargetChannel));
  EXPECT_EQ(brightness(present, others), brightness(none, others));
  EXPECT_EQ(brightness(present, others + 1), 0);
  EXPECT_EQ(brightness(present, scene::kTargetChannel + 1), 0);
}

TEST(SceneLoaderTest, BatchesComeInOrderWhateverTheNumberOfThreads) {
  const auto data = SplitRecordings(ArcRecordings(60), TinySettings());
  ASSERT_TRUE(data.ok());
  std::vector<SceneLoader::Item> items;
  for (int64_t i = 0; i < 45; ++i) {
    items.push_back({(i * 7) % 60, DrawVariation(TinySettings().augmentation(), 2, 1, 1, i)});
  }
  const v1::ModelSpec spec = TinySettings().model();
  const SceneSource source(spec, data->training, 3);
  SceneLoader one(spec, source, items, 4, 1);
  SceneLoader three(spec, source, items, 4, 3);
  size_t seen = 0;
  while (auto batch = one.Next()) {
    const auto other = three.Next();
    ASSERT_TRUE(other);
    EXPECT_TRUE(batch->scenes.rasters.Dense().equal(other->scenes.rasters.Dense()));
    for (const SceneLoader::Item& item : batch->items) {
      EXPECT_EQ(item.example, items[seen++].example);
    }
  }
  EXPECT_EQ(seen, items.size());
  EXPECT_FALSE(three.Next());
}

TEST(SceneLoaderTest, CanBeDestroyedBeforeThePassEnds) {
  const auto data = SplitRecordings(ArcRecordings(60), TinySettings());
  ASSERT_TRUE(data.ok());
  const v1::ModelSpec spec = TinySettings().model();
  const SceneSource source(spec, data->training, 1);
  SceneLoader loader(spec, source, std::vector<SceneLoader::Item>(400), 4, 2);
  EXPECT_TRUE(loader.Next());
}

TEST(SceneLoaderTest, MeasuresHowLongEachBatchWasWaitedFor) {
  const auto data = SplitRecordings(ArcRecordings(60), TinySettings());
  ASSERT_TRUE(data.ok());
  const v1::ModelSpec spec = TinySettings().model();
  const SceneSource source(spec, data->training, 1);
  SceneLoader loader(spec, source, std::vector<SceneLoader::Item>(400), 4, 1);
  const auto begin = std::chrono::steady_clock::now();
  std::chrono::nanoseconds waited{0};
  EXPECT_GT(loader.Next()->waited.count(), 0);  // with the making of the loader, never nothing
  while (const auto batch = loader.Next()) waited += batch->waited;
  EXPECT_GT(waited.count(), 0);
  EXPECT_LE(waited, std::chrono::steady_clock::now() - begin);
}

TEST(SceneLoaderTest, ASlowConsumerNeverWaits) {
  const auto data = SplitRecordings(ArcRecordings(60), TinySettings());
  ASSERT_TRUE(data.ok());
  const v1::ModelSpec spec = TinySettings().model();
  const SceneSource source(spec, data->training, 1);
  bool waited = true;
  // How slow that is depends on what else runs.
  for (int pause = 20; waited && pause < 10'000; pause *= 2) {
    SceneLoader loader(spec, source, std::vector<SceneLoader::Item>(12), 4, 1);
    ASSERT_TRUE(loader.Next());
    std::this_thread::sleep_for(std::chrono::milliseconds(pause));
    waited = loader.Next()->waited.count() > 0 || loader.Next()->waited.count() > 0;
  }
  EXPECT_FALSE(waited);
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

// k-means converges slowly on points that are evenly spread over a line.
TEST(TrajectoryClustersTest, AssignsEachTrajectoryToItsNearestCentreEvenBeforeItConverges) {
  constexpr int kPoints = 2000;
  TrajectoryRows points(kPoints, 2);
  for (int i = 0; i < kPoints; ++i) {
    points.row(i) << 100.0F * static_cast<float>(i) / kPoints - 50.0F, 0.0F;
  }
  const TrajectoryClusters clusters = ClusterTrajectories(points, 10, 2, 1);
  double inertia = 0.0;
  for (int i = 0; i < kPoints; ++i) {
    const Eigen::VectorXf distances =
        (clusters.centers.rowwise() - points.row(i)).rowwise().squaredNorm();
    const float own = distances[clusters.assignment[static_cast<size_t>(i)]];
    EXPECT_NEAR(own, distances.minCoeff(), 1e-3F) << i;
    inertia += own;
  }
  EXPECT_NEAR(clusters.inertia, inertia, 1e-4 * inertia);
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

class TrainingProgressTest : public testing::Test {
 protected:
  std::chrono::system_clock::time_point now_{std::chrono::seconds(1000)};
  std::vector<v1::JobProgress> seen_;
  TrainingProgress progress_{{{"load", 1, 1, 1.0}, {"pretrain", 2, 10, 1.0}, {"joint", 2, 10, 9.0}},
                             [this](const v1::JobProgress& each) { seen_.push_back(each); },
                             [this] { return now_; }};
};

TEST_F(TrainingProgressTest, WeightsStepsByTheirCost) {
  progress_.BeginPhase("pretrain");
  now_ += std::chrono::seconds(1);
  for (int i = 0; i < 10; ++i) progress_.Step(4);
  now_ += std::chrono::seconds(10);
  progress_.BeginPhase("joint");
  EXPECT_NEAR(seen_.back().fraction(), 11.0 / 101.0, 1e-9);
  // Ten steps took 11 s; ten that cost nine times as much are to come.
  EXPECT_NEAR(seen_.back().time_left().seconds(), 99, 1);
}

TEST_F(TrainingProgressTest, ThePhasesOwnStepsPredictItsTimeLeft) {
  progress_.BeginPhase("load");
  now_ += std::chrono::seconds(50);  // says nothing of steps
  progress_.Step(0);
  progress_.BeginPhase("pretrain");
  for (int i = 0; i < 10; ++i) {
    now_ += std::chrono::seconds(1);
    progress_.Step(4);
  }
  progress_.BeginPhase("joint");
  EXPECT_EQ(seen_.back().time_left().seconds(), 90);
  // A step takes twice what the plan says.
  for (int i = 0; i < 5; ++i) {
    now_ += std::chrono::seconds(18);
    progress_.Step(4);
  }
  EXPECT_EQ(seen_.back().time_left().seconds(), 90);
  now_ += std::chrono::seconds(18);
  progress_.Step(4);
  EXPECT_EQ(seen_.back().time_left().seconds(), 72);
}

TEST_F(TrainingProgressTest, StepsOfEachKindPredictTheirOwnTime) {
  TrainingProgress::Phase calibrate{"calibrate", 1, 10, 1.0};
  calibrate.others = {{20, 3.0}};
  TrainingProgress progress(
      {calibrate, {"export", 1, 2, 5.0}},
      [this](const v1::JobProgress& each) { seen_.push_back(each); }, [this] { return now_; });
  progress.BeginPhase("calibrate");
  for (int i = 0; i < 10; ++i) {
    now_ += std::chrono::seconds(2);
    progress.Step(64);
  }
  EXPECT_EQ(seen_.back().step(), 10);
  EXPECT_EQ(seen_.back().steps(), 32);
  EXPECT_NEAR(seen_.back().fraction(), 10.0 / 80.0, 1e-9);
  // Twice what the plan says.
  EXPECT_EQ(seen_.back().time_left().seconds(), 20 * 6 + 2 * 10);
  now_ += std::chrono::seconds(500);  // other work before the first step of the next kind
  progress.Step(0, {}, 1);
  EXPECT_EQ(seen_.back().time_left().seconds(), 19 * 6 + 2 * 10);
  for (int i = 0; i < 5; ++i) {
    now_ += std::chrono::seconds(12);
    progress.Step(0, {}, 1);
  }
  // 15 steps took 80 s and cost 25 units.
  EXPECT_EQ(seen_.back().time_left().seconds(), 14 * 12 + 2 * 5 * 80 / 25);
}

TEST_F(TrainingProgressTest, CostsInSecondsTellTheTimeLeftAtOnceAndOutweighTheFirstSteps) {
  progress_.BeginPhase("load");
  EXPECT_FALSE(seen_.back().has_time_left());
  progress_.Replan({{"load", 1, 1, 1.0}, {"pretrain", 1, 500, 0.5}, {"joint", 2, 100, 7.49}}, true);
  progress_.BeginPhase("pretrain");
  EXPECT_EQ(seen_.back().time_left().seconds(), 250 + 749);
  // Five steps take three times what the plan says, against 2 % of 1000 s as planned.
  for (int i = 0; i < 5; ++i) {
    now_ += std::chrono::milliseconds(1500);
    progress_.Step(4);
  }
  const double slower = (20.0 + 7.5) / (20.0 + 2.5);
  EXPECT_EQ(seen_.back().time_left().seconds(), static_cast<int64_t>(495 * 1.5 + 749 * slower));
}

TEST_F(TrainingProgressTest, DoesNotRoundTheTimeLeft) {
  progress_.BeginPhase("joint");
  for (int i = 0; i < 9; ++i) {
    now_ += std::chrono::milliseconds(1250);
    progress_.Step(4);
  }
  EXPECT_EQ(seen_.back().time_left().seconds(), 1);
  EXPECT_EQ(seen_.back().time_left().nanos(), 250'000'000);
}

TEST_F(TrainingProgressTest, DoesNotTimeStepsOfAnotherRun) {
  progress_.BeginPhase("joint");
  progress_.Resume(4);
  for (int i = 0; i < 5; ++i) {
    now_ += std::chrono::seconds(10);
    progress_.Step(4);
  }
  EXPECT_EQ(seen_.back().time_left().seconds(), 10);
}

TEST_F(TrainingProgressTest, SharesTheTimeOfStepsBetweenWaitingAndLearning) {
  using std::chrono::milliseconds;
  progress_.BeginPhase("pretrain");
  now_ += milliseconds(700);
  progress_.Step(4, milliseconds(350));
  EXPECT_EQ(seen_.back().waiting_fraction(), 0.5);
  progress_.BeginPhase("joint");  // anew
  EXPECT_EQ(seen_.back().waiting_fraction(), 0.0);
  for (int epoch = 1; epoch <= 2; ++epoch) {
    progress_.BeginEpoch(epoch);
    now_ += milliseconds(600);
    progress_.Step(4, milliseconds(150));
    now_ += milliseconds(400);
    progress_.Step(4);
    now_ += milliseconds(9000);  // validation: no step's time
    progress_.EndEpoch({});
  }
  EXPECT_NEAR(seen_.back().waiting_fraction(), 0.15, 1e-9);
}

TEST_F(TrainingProgressTest, ReportsAFewTimesASecondAndEachEpoch) {
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
}  // namespace maneuver::learning::learning_data_test
