// That recalibration mends widths that are wrong, and leaves everything else as it is.

#include "model/learning/recalibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "model/artifact/model_folder.h"
#include "model/data/dataset_folder.h"
#include "model/evaluation/evaluator.h"
#include "model/inference/action_model.h"
#include "model/learning/calibration.h"
#include "model/learning/covariance_fit.h"
#include "model/learning/networks.h"
#include "model/learning/predictions.h"
#include "model/learning/speed_factors.h"
#include "model/learning/trainer.h"
#include "model/learning/training_failure.h"
#include "model/learning/validation.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::learning::recalibration_test {
namespace {

namespace fs = std::filesystem;

v1::TrainingSettings SettingsOf(const std::string& kind) {
  v1::TrainingSettings settings = kind == "lanes" ? TinyLanesSettings() : TinySettings();
  v1::OptimizationSettings& optimization = *settings.mutable_optimization();
  optimization.set_pretraining_epochs(8);
  optimization.set_mixture_epochs(6);
  optimization.set_joint_epochs(3);
  optimization.set_posterior_epochs(1);
  if (optimization.covariance_epochs() > 0) optimization.set_covariance_epochs(3);
  optimization.set_covered_share(0.86);
  return settings;
}

// Vehicles that wander about their lanes, so that the errors of a prediction are no smaller than its
// widths.
//   name: recordings of another name are others
std::vector<v1::Scenario> Recordings(const std::string& name, int count) {
  std::vector<v1::Scenario> recordings = ArcRecordings(count);
  std::mt19937 random(static_cast<uint32_t>(name[0]));
  std::uniform_real_distribution<double> phase(0.0, 6.28);
  for (v1::Scenario& recording : recordings) {
    recording.set_scenario_id(name + recording.scenario_id());
    const double along = phase(random), across = phase(random);
    for (v1::AgentState& state : *recording.mutable_agents(0)->mutable_states()) {
      state.set_x(state.x() + 0.8 * std::sin(1.3 * state.time() + along));
      state.set_y(state.y() + 0.8 * std::sin(1.1 * state.time() + across));
    }
  }
  return recordings;
}

class RecalibrationTest : public testing::TestWithParam<std::string> {
 protected:
  void Learn() {
    TrainingRun run;
    run.settings = settings_;
    run.output = folder_ / "learned";
    const auto manifest = Train(run, *SplitRecordings(Recordings("a", 60), settings_));
    ASSERT_TRUE(manifest.ok()) << manifest.status();
  }

  // Writes the learned model with covariances of `variance` and logits of `logit` times their size.
  void Spoil(float variance, float logit) {
    auto model = *artifact::ReadModelFolder(folder_ / "learned");
    const auto scale = [&model](const std::string& name, float factor) {
      for (float& value : model.weights.at(name).values) value *= factor;
    };
    scale(width_, variance);
    for (const std::string& name : Logits(model)) scale(name, logit);
    model.manifest.mutable_actions(1)->set_label("bend");
    ASSERT_TRUE(artifact::WriteModelFolder(folder_ / "spoilt", std::move(model)).ok());
  }

  static std::set<std::string> Logits(const artifact::StoredModel& model) {
    const std::string last = "action_predictor." +
                             std::to_string(model.manifest.spec().action_predictor().hidden_size());
    std::set<std::string> names = {last + ".weight", last + ".bias"};
    const std::string geometry = "action_geometry.logit.weight";
    if (model.weights.contains(geometry)) names.insert(geometry);
    return names;
  }

  fs::path Dataset(const std::string& name, int count) {
    auto writer = data::DatasetWriter::Create(folder_ / name, "test");
    for (const v1::Scenario& recording : Recordings(name, count)) {
      EXPECT_TRUE((*writer)->Add(recording).ok());
    }
    EXPECT_TRUE((*writer)->Commit().ok());
    return folder_ / name;
  }

  RecalibrationRun Run(const std::string& model) {
    RecalibrationRun run;
    run.model = folder_ / model;
    run.model_name = "models/arcs/versions/1";
    run.output = folder_ / "mended";
    run.examples = settings_.examples();
    run.dataset_names = {"datasets/outcomes"};
    run.threads = 1;
    return run;
  }

  std::map<std::string, double> Measure(const std::string& model,
                                        const std::vector<v1::Scenario>& recordings) {
    const auto loaded = inference::ActionModel::Load(folder_ / model, {});
    EXPECT_TRUE(loaded.ok()) << loaded.status();
    evaluation::EvaluationInput input;
    input.recordings = recordings;
    input.examples = settings_.examples();
    const auto report = evaluation::Evaluate(**loaded, input);
    EXPECT_TRUE(report.ok()) << report.status();
    return {report->metrics().begin(), report->metrics().end()};
  }

  const v1::TrainingSettings settings_ = SettingsOf(GetParam());
  const std::string width_ =
      GetParam() == "lanes" ? "scene_covariance.speed_factor" : "decoder.covariance";
  const TemporaryFolder folder_;
};

TEST_P(RecalibrationTest, MendsWrongWidthsOnOtherRecordingsAndKeepsTheNetworks) {
  Learn();
  const auto learned = Measure("learned", Recordings("c", 30));
  for (const float variance : {0.02F, 40.0F}) {
    SCOPED_TRACE(variance);
    fs::remove_all(folder_ / "spoilt");
    fs::remove_all(folder_ / "mended");
    Spoil(variance, variance < 1.0F ? 3.0F : 0.4F);
    const auto manifest = Recalibrate(Run("spoilt"), {Dataset("b" + std::to_string(variance), 60)});
    ASSERT_TRUE(manifest.ok()) << manifest.status();

    const auto before = Measure("spoilt", Recordings("c", 30));
    const auto after = Measure("mended", Recordings("c", 30));
    EXPECT_LT(after.at("nll"), before.at("nll") - 0.2);
    EXPECT_NEAR(after.at("nll"), learned.at("nll"), 0.1);
    EXPECT_GT(std::abs(before.at("coverage_2sigma") - 0.86), 0.1);
    EXPECT_NEAR(after.at("coverage_2sigma"), 0.86, 0.08);

    const auto spoilt = *artifact::ReadModelFolder(folder_ / "spoilt");
    const auto mended = *artifact::ReadModelFolder(folder_ / "mended");
    std::set<std::string> changed;
    for (const auto& [name, tensor] : mended.weights) {
      if (tensor.values != spoilt.weights.at(name).values) changed.insert(name);
    }
    std::set<std::string> expected = Logits(spoilt);
    expected.insert(width_);
    EXPECT_EQ(changed, expected);

    EXPECT_EQ(manifest->provenance().start_from(), "models/arcs/versions/1");
    EXPECT_EQ(manifest->provenance().datasets(0), "datasets/outcomes");
    EXPECT_EQ(manifest->provenance().settings().optimization().joint_epochs(), 0);
    EXPECT_GT(manifest->provenance().validation_examples(), 0);
    EXPECT_EQ(manifest->metrics().count("nll"), 1u);
    const auto& ranges = manifest->input_ranges();
    ASSERT_EQ(ranges.size(), 3u);
    for (const auto& [name, range] : spoilt.manifest.input_ranges()) {
      EXPECT_EQ(ranges.at(name).low(), range.low()) << name;
      EXPECT_EQ(ranges.at(name).high(), range.high()) << name;
    }
    ASSERT_EQ(manifest->actions_size(), spoilt.manifest.actions_size());
    for (int k = 0; k < manifest->actions_size(); ++k) {
      EXPECT_EQ(manifest->actions(k).label(), k == 1 ? "bend" : "");
      EXPECT_EQ(manifest->actions(k).derived_name(), spoilt.manifest.actions(k).derived_name());
      EXPECT_EQ(manifest->actions(k).usage(), spoilt.manifest.actions(k).usage());
    }
  }
}

// Widths are fitted to each example's own action, and which one that is depends on p(y|s).
TEST_P(RecalibrationTest, TheCoveredShareIsThatOfTheMendedProbabilities) {
  Learn();
  Spoil(1.0F, 3.0F);
  const TrainingData data = *SplitRecordings(Recordings("b", 60), settings_);
  at::Generator generator = MakeGenerator(1);
  Networks networks(settings_.model(), at::Device(at::kCPU), generator);
  networks.Standardize(Trajectories(data.training.examples), false);
  networks.Import(artifact::ReadModelFolder(folder_ / "spoilt")->weights);
  const SceneSource source(settings_.model(), data.training, 1);
  constexpr int64_t kMost = 3072;
  const double share = settings_.optimization().covered_share();
  const auto stopped = [] { return false; };
  ASSERT_TRUE(RecalibrateModel(networks, source, kMost, share, 1, stopped, {}).ok());

  const Predictions mended =
      Predict(networks, EncodeExamples(networks, source, kMost, 1, stopped, {}));
  const bool by_scene = networks.spec().has_scene_covariance();
  at::NoGradGuard no_grad;
  const at::Tensor covariance =
      by_scene ? WithSpeedFactors(mended, networks[width_]) : networks["decoder.covariance"];
  const double covered = CoveredShare(mended, covariance);
  const double waypoint = 2.0 / static_cast<double>(mended.trajectories.numel());
  EXPECT_GE(covered, share - 1.5 * waypoint);
  // Where the scene predicts the covariance, it is as narrow as that.
  if (by_scene) {
    EXPECT_LE(covered, share + 1.5 * waypoint);
  }
}

INSTANTIATE_TEST_SUITE_P(, RecalibrationTest, testing::Values("raster", "lanes"),
                         [](const auto& kind) { return kind.param; });

using RefusedRecalibrationTest = RecalibrationTest;

TEST_P(RefusedRecalibrationTest, TooFewExamplesLeaveNothingBehind) {
  Learn();
  const auto few = Recalibrate(Run("learned"), {Dataset("b", 4)});
  EXPECT_EQ(FailureOf(few.status()), TrainingFailure::kNotEnoughExamples) << few.status();
  EXPECT_THAT(few.status().message(), testing::HasSubstr("Collect more outcomes"));
  EXPECT_THAT(few.status().message(), testing::Not(testing::HasSubstr("model.actions")));
  EXPECT_FALSE(fs::exists(folder_ / "mended"));
  const auto none = Recalibrate(Run("nowhere"), {folder_ / "b"});
  EXPECT_TRUE(absl::IsNotFound(none.status())) << none.status();
  RecalibrationRun stopped = Run("learned");
  stopped.stopped = [] { return true; };
  EXPECT_TRUE(absl::IsCancelled(Recalibrate(stopped, {Dataset("d", 60)}).status()));
  EXPECT_FALSE(fs::exists(folder_ / "mended"));
}

INSTANTIATE_TEST_SUITE_P(, RefusedRecalibrationTest, testing::Values("raster"),
                         [](const auto& kind) { return kind.param; });

}  // namespace
}  // namespace maneuver::learning::recalibration_test
