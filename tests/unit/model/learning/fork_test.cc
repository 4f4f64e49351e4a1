// A problem whose answer is known: two well-separated families of trajectories, arcs to the left
// and to the right, and scenes that decide between them half the time. Where the map shows one lane
// the vehicle follows it; where it shows both, it goes left in 70 of 100.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "model/inference/action_model.h"
#include "model/learning/trainer.h"
#include "model/scene/rasterizer.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::learning::fork_test {
namespace {

constexpr double kLeftAtForks = 0.7;

v1::TrainingSettings ForkSettings(v1::Objective objective) {
  v1::TrainingSettings settings = TinySettings();
  settings.mutable_model()->set_objective(objective);
  settings.mutable_model()->set_actions(4);
  // One example a recording, 1 s before the fork, to 4 s after it.
  settings.mutable_model()->mutable_trajectory()->set_waypoints(10);
  settings.mutable_model()->mutable_trajectory()->mutable_waypoint_interval()->set_nanos(
      500'000'000);
  settings.mutable_examples()->mutable_stride()->set_seconds(1);
  settings.mutable_examples()->mutable_stride()->set_nanos(0);
  settings.mutable_examples()->set_validation_share(0.0);
  settings.mutable_augmentation()->set_mirror(false);
  // Ten waypoints, a fifth of the preset's, pull as hard.
  settings.mutable_optimization()->set_posterior_reconstruction_weight(0.25);
  settings.mutable_optimization()->set_pretraining_epochs(25);
  settings.mutable_optimization()->set_mixture_epochs(10);
  settings.mutable_optimization()->set_joint_epochs(20);
  settings.mutable_optimization()->set_posterior_epochs(20);
  return settings;
}

TrainingData Forks(const v1::TrainingSettings& settings) {
  TrainingData data;
  for (int i = 0; i < 400; ++i) {
    // Eleven curvatures and ten outcomes: the one tells nothing about the other.
    const double curvature = 0.03 + 0.004 * (i / 2 % 11);
    const bool at_fork = i % 2 == 0;
    const bool left = at_fork ? (i / 2 * 7) % 10 < 10 * kLeftAtForks : i / 2 % 2 == 0;
    const Fork lanes = at_fork ? Fork::kBoth : left ? Fork::kLeft : Fork::kRight;
    data.training.recordings.push_back(
        ForkRecording("fork-" + std::to_string(i), lanes, left, curvature));
    for (data::Example& example : data::EnumerateExamples(data.training.recordings.back(), i,
                                                          settings.model(), settings.examples())) {
      if (std::abs(example.time - 1.0) < 0.05) data.training.examples.push_back(example);
    }
  }
  return data;
}

struct Answer {
  double left = 0.0;             // probability of the actions that go left
  double responsibility = 0.0;   // share of q(y|x,s) in actions that go the way it went
  double posterior_error = 0.0;  // of the most responsible action's mean at the end, metres
  double generic_error = 0.0;    // likewise of p(z|y)
};

class ForkTest : public testing::TestWithParam<v1::Objective> {
 protected:
  void SetUp() override {
    TrainingRun run;
    run.settings = ForkSettings(GetParam());
    run.output = folder_ / "model";
    const auto manifest = Train(run, Forks(run.settings));
    ASSERT_TRUE(manifest.ok()) << manifest.status();
    model_ = inference::ActionModel::Load(run.output, {inference::Precision::kF32}).value();
    session_ = model_->NewSession();
  }

  Answer Ask(Fork lanes, bool left, double curvature) {
    const v1::Scenario scenario = ForkRecording("unseen", lanes, left, curvature);
    const v1::TrainingSettings settings = ForkSettings(GetParam());
    const std::vector<data::Example> examples =
        data::EnumerateExamples(scenario, 0, settings.model(), settings.examples());
    const data::Example& example = examples.at(0);
    scene::Raster raster = scene::NewRaster(settings.model().raster());
    scene::Rasterizer(settings.model().raster())
        .Rasterize(scenario, scene::RoadMap::Over(scenario.map_features()), example.time, 1,
                   example.X_WT, {}, &raster);
    const inference::SceneInputsView scene{&raster, example.motion};
    inference::SceneEncoding encoding;
    session_->Encode({&scene, 1}, {&encoding, 1});
    const std::vector<int> actions = {0, 1, 2, 3};
    const auto generic = session_->Describe(encoding, actions, inference::LatentSource::kPrior);
    const auto posterior =
        session_->Describe(encoding, actions, inference::LatentSource::kPosterior);
    inference::Trajectory truth(10, 2);
    for (Eigen::Index i = 0; i < truth.size(); ++i) truth.data()[i] = example.trajectory[i];
    const auto classified = session_->Classify(encoding, truth);
    Answer answer;
    Eigen::Index most = 0;
    classified.responsibilities.maxCoeff(&most);
    for (const int k : actions) {
      const bool goes_left = generic[k].mean()(9, 1) > 0.0;
      if (goes_left) answer.left += encoding.probabilities[k];
      if (goes_left == left) answer.responsibility += classified.responsibilities[k];
    }
    answer.posterior_error = (posterior[most].mean().row(9) - truth.row(9)).norm();
    answer.generic_error = (generic[most].mean().row(9) - truth.row(9)).norm();
    return answer;
  }

  const TemporaryFolder folder_;
  std::shared_ptr<const inference::ActionModel> model_;
  std::unique_ptr<inference::InferenceSession> session_;
};

TEST_P(ForkTest, LearnsTheKnownProbabilitiesResponsibilitiesAndLatents) {
  double undecided = 0.0, generic = 0.0, posterior = 0.0;
  int asked = 0;
  for (const double curvature : {0.032, 0.041, 0.05, 0.059, 0.068}) {
    EXPECT_NEAR(Ask(Fork::kLeft, true, curvature).left, 1.0, 0.05);
    EXPECT_NEAR(Ask(Fork::kRight, false, curvature).left, 0.0, 0.05);
    for (const bool left : {true, false}) {
      const Answer answer = Ask(Fork::kBoth, left, curvature);
      undecided += answer.left;
      EXPECT_GT(answer.responsibility, 0.99);
      generic += answer.generic_error;
      posterior += answer.posterior_error;
      ++asked;
    }
  }
  EXPECT_NEAR(undecided / asked, kLeftAtForks, 0.05);
  // The lane shows how sharp the arc is; q(z|y,s) can know.
  if (GetParam() == v1::OBJECTIVE_BASE) {
    EXPECT_NEAR(posterior, generic, 1e-6);
  } else {
    EXPECT_LT(posterior, 0.6 * generic) << posterior / asked << " against " << generic / asked;
  }
}

INSTANTIATE_TEST_SUITE_P(Objectives, ForkTest,
                         testing::Values(v1::OBJECTIVE_BASE, v1::OBJECTIVE_DUAL,
                                         v1::OBJECTIVE_UNIFIED),
                         [](const testing::TestParamInfo<v1::Objective>& objective) {
                           switch (objective.param) {
                             case v1::OBJECTIVE_BASE:
                               return "Base";
                             case v1::OBJECTIVE_DUAL:
                               return "Dual";
                             default:
                               return "Unified";
                           }
                         });

}  // namespace
}  // namespace maneuver::learning::fork_test
