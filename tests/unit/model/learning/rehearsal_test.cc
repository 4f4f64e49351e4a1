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
#include "model/learning/anchors/anchor_learner.h"
#include "model/learning/checkpoint_contents.h"
#include "model/learning/learner.h"
#include "model/learning/measuring_time.h"
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
  std::optional<double> Rehearse(int64_t planned, absl::Status (*learn)(LearningState&, EpochLoop&),
                                 int ranks = 1) {
    return RehearseStep({"joint", kEpochs, planned, 1.0},
                        {"joint", settings_.optimization().batch_size(), learn, ranks}, state_,
                        [] { return now; });
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

TEST_F(RehearsalTest, RanksShareAStepAndOneOfThemValidates) {
  EXPECT_NEAR(*Rehearse(400, LearnSlowly, 4), 2.0 / 4.0 + (12.0 + 10.0) * kEpochs / 400.0, 1e-6);
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

// Returns the seconds of a step that is rehearsed by the clock of the machine.
std::optional<double> RehearseForReal(const RehearsedPhase& phase, LearningState& state) {
  return RehearseStep({phase.name, kEpochs, 400, 1.0}, phase, state,
                      [] { return std::chrono::system_clock::now(); });
}

TEST_F(RehearsalTest, RehearsesMicroBatches) {
  v1::TrainingSettings settings = settings_;
  settings.mutable_optimization()->set_micro_batches(4);
  LearningState state(settings, data_, at::Device(at::kCPU), 1, [] { return false; });
  const std::optional<double> step =
      RehearseForReal({"joint", settings.optimization().batch_size(), TrainJointly}, state);
  ASSERT_TRUE(step);
  EXPECT_GT(*step, 0.0);
}

TEST_F(RehearsalTest, BaselinesAreRehearsedOnOtherWeightsThanTheirOwn) {
  RankGroup alone([] { return false; });
  TrainingProgress unheard({{"covernet"}}, nullptr, [] { return now; });
  EpochLoop loop(settings_, data_, alone, unheard);
  AnchorLearner anchors(state_, loop);
  const Networks::Snapshot before = state_.networks.Save();
  std::vector<std::string> names;
  for (const RehearsedPhase& phase : anchors.Rehearsed()) {
    names.push_back(phase.name);
    const std::optional<double> step = RehearseForReal(phase, state_);
    ASSERT_TRUE(step) << phase.name;
    EXPECT_GT(*step, 0.0) << phase.name;
  }
  EXPECT_EQ(names, (std::vector<std::string>{"covernet", "multipath"}));
  for (const auto& [name, tensor] : before) {
    EXPECT_TRUE(at::equal(state_.networks[name], tensor)) << name;
  }
}

TEST(MeasuringTimeTest, ExtrapolatesTheFirstExamplesWithoutWhatPrecedesThem) {
  now = {};
  MeasuringTime time([] { return now; });
  EXPECT_FALSE(time.Seconds());
  Pass(0.5 + 64 * 0.005);  // reads the model and the recordings first
  EXPECT_TRUE(time.Continue(64, 1000));
  EXPECT_FALSE(time.Seconds());
  int64_t done = 64;
  bool goes_on = true;
  while (goes_on) {
    Pass(64 * 0.005);
    done += 64;
    goes_on = time.Continue(done, 2000);
  }
  EXPECT_EQ(done, 64 * 5);  // after a second
  EXPECT_NEAR(*time.Seconds(), 0.5 + 2000 * 0.005, 1e-6);
}

// Seconds that each phase of the quickstart's training took, and what a step was rehearsed to take.
struct Took {
  std::string phase;
  double seconds = 0.0;
  int64_t steps = 0;
};

// The settings of the quickstart.
v1::TrainingSettings QuickstartSettings() {
  v1::TrainingSettings wanted;
  wanted.set_preset("lanes");
  wanted.mutable_examples()->set_max_examples(6000);
  wanted.mutable_optimization()->set_mixture_epochs(60);
  wanted.mutable_optimization()->set_joint_epochs(8);
  wanted.mutable_optimization()->set_covariance_epochs(3);
  return artifact::ResolveTrainingSettings(wanted);
}

// Runs the plan in the time that its phases took. Expects every report after a tenth of it to be
// right, within a quarter, about the time that is left.
void ExpectTheTimeLeftToBeRight(const std::vector<TrainingProgress::Phase>& plan,
                                const std::map<std::string, double>& rehearsed,
                                const std::vector<Took>& took) {
  double whole = 0.0;
  for (const Took& each : took) whole += each.seconds;
  now = {};
  double last = -1.0;  // time left that was reported last
  double fraction = 0.0;
  TrainingProgress progress(
      WithMeasuredSteps(plan, rehearsed),
      [&](const v1::JobProgress& each) {
        if (each.has_time_left()) last = static_cast<double>(each.time_left().seconds());
        fraction = each.fraction();
      },
      [] { return now; });
  for (const Took& each : took) {
    const auto planned = std::ranges::find(plan, each.phase, &TrainingProgress::Phase::name);
    ASSERT_NE(planned, plan.end()) << each.phase;
    if (each.steps > 0) {
      EXPECT_EQ(planned->steps, each.steps) << each.phase;
    }
    if (planned->seconds) continue;  // after the run
    progress.BeginPhase(each.phase);
    for (int64_t step = 0; step < planned->steps; ++step) {
      Pass(each.seconds / static_cast<double>(planned->steps));
      progress.Step(1);
      const double passed = std::chrono::duration<double>(now.time_since_epoch()).count();
      const double left = whole - passed;
      if (passed < 0.1 * whole || left < 2.0) continue;
      // The report is half a second old and in whole seconds.
      EXPECT_NEAR(last, left, 0.25 * left + 1.5) << each.phase << " " << step;
      EXPECT_NEAR(fraction, passed / whole, 0.1) << each.phase << " " << step;
    }
  }
}

TEST(TimeLeftTest, IsWithinAQuarterFromATenthOfTheTimeOn) {
  // Measured on a town of 240 recordings, with two threads on two idle cores.
  ExpectTheTimeLeftToBeRight(
      Learner::Plan(QuickstartSettings(), 30'000, 30'000, 1770),
      {{"pretrain", 3.6 / 1440}, {"joint", 18.2 / 376}, {"covariance", 3.4 / 141}},
      {{"load", 2.0, 1},
       {"pretrain", 3.6, 1440},
       {"mixture", 5.0, 1440},
       {"joint", 18.2, 376},
       {"covariance", 3.4, 141},
       {"calibrate", 3.8, 0},
       {"export", 0.1, 1},
       {"evaluate", 0.5, 100}});
}

TEST(TimeLeftTest, CountsBaselinesTheirCalibrationAndWhatFollowsTheRun) {
  const v1::TrainingSettings settings = QuickstartSettings();
  std::vector<TrainingProgress::Phase> plan = Learner::Plan(settings, 30'000, 30'000, 1770);
  AnchorLearner::AddPhases(settings, 30'000, 30'000, 1770, &plan);
  plan.push_back({"after", 1, 1, 9'999.0, 20.0});
  // Processor time of one thread, on the same town.
  ExpectTheTimeLeftToBeRight(plan,
                             {{"pretrain", 3.9 / 1440},
                              {"joint", 23.2 / 376},
                              {"covariance", 4.7 / 141},
                              {"covernet", 4.3 / 376},
                              {"multipath", 11.0 / 376}},
                             {{"load", 2.7, 1},
                              {"pretrain", 3.9, 1440},
                              {"mixture", 5.8, 1440},
                              {"joint", 23.2, 376},
                              {"covariance", 4.7, 141},
                              {"calibrate", 6.5, 0},
                              {"covernet", 4.3, 376},
                              {"calibrate covernet", 2.9, 0},
                              {"multipath", 11.0, 376},
                              {"calibrate multipath", 1.9, 0},
                              {"export", 0.1, 1},
                              {"evaluate", 1.6, 100},
                              {"after", 20.0, 1}});
}

}  // namespace
}  // namespace maneuver::learning::rehearsal_test
