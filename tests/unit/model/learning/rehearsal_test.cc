// How a run knows how long it will take.

#include "model/learning/phases/rehearsal.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "model/artifact/training_presets.h"
#include "model/learning/checkpoint_contents.h"
#include "model/learning/learner.h"
#include "model/learning/phases/joint.h"
#include "tests/unit/model/learning/analytic_scenes.h"

namespace maneuver::learning::rehearsal_test {
namespace {

using Time = std::chrono::system_clock::time_point;

Time now{};  // of the fake clock

void Pass(double seconds) {
  now += std::chrono::duration_cast<Time::duration>(std::chrono::duration<double>(seconds));
}

// Steps of two seconds, the first of which waits for ten more, and a validation of twelve.
class SlowSteps final : public EpochSteps {
 public:
  explicit SlowSteps(const at::Tensor& parameter) : parameter_(parameter) {}

  absl::Status BeginEpoch(const EpochStart&) override {
    Pass(10.0);
    return absl::OkStatus();
  }
  absl::StatusOr<BatchLoss> Next(const Moment&, TermMeans*) override {
    Pass(2.0);
    return BatchLoss{parameter_.sum(), 1};
  }
  void EndEpoch(v1::EpochReport*) override { Pass(12.0); }

 private:
  at::Tensor parameter_;
};

constexpr int kEpochs = 4;

absl::Status LearnSlowly(LearningState& state, EpochLoop& loop) {
  at::Tensor parameter = at::ones({1});
  parameter.set_requires_grad(true);
  AdamW optimizer;
  optimizer.Add({parameter}, 1e-3, 0.0);
  SlowSteps steps(parameter);
  return loop.Run(
      {"joint", kEpochs, state.settings.optimization().batch_size(), state.data.TrainingExamples()},
      {state.generator, optimizer, [](Checkpoint*) {}}, steps);
}

class RehearsalTest : public testing::Test {
 protected:
  std::optional<double> Rehearse(int64_t planned, PhaseFunction learn) {
    return RehearseStep({"joint", kEpochs, planned, 1.0}, settings_.optimization().batch_size(),
                        learn, state_, [] { return now; });
  }

  const v1::TrainingSettings settings_ = TinySettings();
  const TrainingData data_ = *SplitRecordings(ArcRecordings(72), settings_);
  bool stopped_ = false;
  LearningState state_{settings_, data_, at::Device(at::kCPU), 1, [this] { return stopped_; }};
};

TEST_F(RehearsalTest, AStepHasItsShareOfTheValidation) {
  // The second epoch begins with a wait of ten seconds, which the loop has before it is stopped.
  EXPECT_NEAR(*Rehearse(400, LearnSlowly), 2.0 + (12.0 + 10.0) * kEpochs / 400.0, 1e-6);
}

TEST_F(RehearsalTest, MeasuresNothingIfThePhaseIsShortOrTheRunStops) {
  EXPECT_FALSE(Rehearse(99, LearnSlowly));
  stopped_ = true;
  EXPECT_FALSE(Rehearse(400, LearnSlowly));
}

TEST_F(RehearsalTest, LeavesTheRunAsItWas) {
  const Networks::Snapshot before = state_.networks.Save();
  const std::string random = RandomState(state_.generator);
  EXPECT_TRUE(Rehearse(400, TrainJointly));
  EXPECT_EQ(RandomState(state_.generator), random);
  for (const auto& [name, tensor] : before) {
    EXPECT_TRUE(at::equal(state_.networks[name], tensor)) << name;
    EXPECT_FALSE(state_.networks[name].grad().defined()) << name;
  }
}

// Seconds that each phase of the quickstart's training took, and what a step was rehearsed to take.
struct Took {
  std::string phase;
  double seconds = 0.0;
  int64_t steps = 0;
};

TEST(TimeLeftTest, IsWithinAQuarterFromATenthOfTheTimeOn) {
  v1::TrainingSettings wanted;
  wanted.set_preset("lanes");
  wanted.mutable_examples()->set_max_examples(6000);
  wanted.mutable_optimization()->set_mixture_epochs(60);
  wanted.mutable_optimization()->set_joint_epochs(8);
  wanted.mutable_optimization()->set_covariance_epochs(3);
  const v1::TrainingSettings settings = artifact::ResolveTrainingSettings(wanted);
  // Measured on a town of 240 recordings, with two threads on two idle cores.
  const std::vector<Took> took = {{"load", 2.0, 1},         {"pretrain", 3.6, 1440},
                                  {"mixture", 5.0, 1440},   {"joint", 18.2, 376},
                                  {"covariance", 3.4, 141}, {"calibrate", 3.8, 0},
                                  {"export", 0.1, 1},       {"evaluate", 0.5, 100}};
  double whole = 0.0;
  for (const Took& each : took) whole += each.seconds;

  std::vector<TrainingProgress::Phase> plan = Learner::Plan(settings, 30'000, 30'000, 1770);
  now = {};
  double last = -1.0;  // time left that was reported last
  TrainingProgress progress(
      WithMeasuredSteps(
          plan, {{"pretrain", 3.6 / 1440}, {"joint", 18.2 / 376}, {"covariance", 3.4 / 141}}),
      [&](const v1::JobProgress& each) {
        if (each.has_time_left()) last = static_cast<double>(each.time_left().seconds());
      },
      [] { return now; });
  for (const Took& each : took) {
    progress.BeginPhase(each.phase);
    const auto planned = std::ranges::find(plan, each.phase, &TrainingProgress::Phase::name);
    for (int64_t step = 0; step < planned->steps; ++step) {
      Pass(each.seconds / static_cast<double>(planned->steps));
      progress.Step(1);
      const double passed = std::chrono::duration<double>(now.time_since_epoch()).count();
      const double left = whole - passed;
      if (passed < 0.1 * whole || left < 2.0) continue;
      // The report is half a second old and in whole seconds.
      EXPECT_NEAR(last, left, 0.25 * left + 1.5) << each.phase << " " << step;
    }
    if (each.steps > 0) {
      EXPECT_EQ(planned->steps, each.steps) << each.phase;
    }
  }
}

}  // namespace
}  // namespace maneuver::learning::rehearsal_test
