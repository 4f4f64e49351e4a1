// How a run knows how long it will take.

#include "model/learning/phases/rehearsal.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <numeric>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "model/artifact/training_presets.h"
#include "model/learning/anchors/anchor_learner.h"
#include "model/learning/calibration.h"
#include "model/learning/checkpoint_contents.h"
#include "model/learning/export.h"
#include "model/learning/learner.h"
#include "model/learning/measuring_time.h"
#include "model/learning/phases/calibrate.h"
#include "model/learning/phases/joint.h"
#include "model/learning/run_examples.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/temporary_folder.h"

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
  absl::StatusOr<BatchLoss> Next(const StepContext&, TermMeans*) override {
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

// Calibrates as the model does, in a time of its own for each example of a step, and with other
// work before a step of another kind.
class SlowCalibration {
 public:
  static constexpr double kSeconds[] = {0.25, 0.5, 0.125, 2.0};

  explicit SlowCalibration(LearningState& state) : state_(state) {}

  absl::Status operator()(const CalibrationExamples& most,
                          const CountCalibrationStep& count) const {
    std::optional<CalibrationStep> last;
    return CalibrateBy(most, state_, [&](CalibrationStep kind, int64_t examples) {
      if (last != kind) Pass(1000.0);
      Pass(kSeconds[static_cast<size_t>(kind)] * static_cast<double>(examples));
      last = kind;
      count(kind, examples);
    });
  }

 private:
  LearningState& state_;
};

TEST_F(RehearsalTest, CalibratesByAFewExamplesAndLeavesTheRunAsItWas) {
  const Networks::Snapshot before = state_.networks.Save();
  const std::string random = RandomState(state_.generator);
  const CalibrationPlan steps = {{{100, 64}, {200, 32}, {80, 512}, {80, 1500}}};
  const auto seconds = RehearseCalibration(
      {"calibrate", {4096, 1500}, steps, SlowCalibration(state_)}, state_, [] { return now; });
  ASSERT_TRUE(seconds);
  ASSERT_EQ(seconds->size(), kCalibrationStepKinds);
  for (size_t kind = 0; kind < kCalibrationStepKinds; ++kind) {
    EXPECT_NEAR(seconds->at(kind),
                SlowCalibration::kSeconds[kind] * static_cast<double>(steps[kind].examples), 1e-3)
        << kind;
  }
  EXPECT_EQ(RandomState(state_.generator), random);
  for (const auto& [name, tensor] : before) {
    EXPECT_TRUE(at::equal(state_.networks[name], tensor)) << name;
    EXPECT_FALSE(state_.networks[name].grad().defined()) << name;
  }
}

TEST_F(RehearsalTest, MeasuresNoCalibrationByFewExamplesOrIfTheRunStops) {
  const auto measures = [this](int64_t held_out) {
    return RehearseCalibration({"calibrate",
                                {4096, held_out},
                                {{{100, 64}, {0, 32}, {0, 0}, {0, 0}}},
                                SlowCalibration(state_)},
                               state_, [] { return now; })
        .has_value();
  };
  EXPECT_FALSE(measures(399));
  EXPECT_TRUE(measures(400));
  stopped_ = true;
  EXPECT_FALSE(measures(400));
}

// Each calibration takes the steps that its plan says, which the time left relies on.
class PlannedCalibrationTest : public testing::TestWithParam<v1::DecoderCovariance> {};

TEST_P(PlannedCalibrationTest, TakesThePlannedSteps) {
  v1::TrainingSettings settings =
      GetParam() == v1::DECODER_COVARIANCE_SCENE ? TinyLanesSettings() : TinySettings();
  settings.mutable_optimization()->set_decoder_covariance(GetParam());
  settings.mutable_examples()->set_validation_share(0.4);
  if (GetParam() == v1::DECODER_COVARIANCE_PREDICTED) {
    settings.mutable_model()->mutable_decoder_covariance()->add_hidden(8);
  }
  const TrainingData data = *SplitRecordings(ArcRecordings(72), settings);
  const CalibrationExamples examples = CountRunExamples(settings.model(), data).Calibrated();
  ASSERT_GE(examples.held_out, artifact::kFewestHeldOut);
  LearningState state(settings, data, at::Device(at::kCPU), 1, [] { return false; });
  CalibrationPlan taken;
  ASSERT_TRUE(CalibrateBy(examples, state, [&](CalibrationStep kind, int64_t of_step) {
                PlannedSteps& steps = taken[static_cast<size_t>(kind)];
                ++steps.count;
                steps.examples = std::max(steps.examples, of_step);
              }).ok());
  const CalibrationPlan plan = PlanCalibration(settings, examples);
  for (size_t kind = 0; kind < kCalibrationStepKinds; ++kind) {
    EXPECT_EQ(taken[kind].count, plan[kind].count) << kind;
    if (plan[kind].count > 0) {
      EXPECT_EQ(taken[kind].examples, plan[kind].examples) << kind;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Covariances, PlannedCalibrationTest,
                         testing::Values(v1::DECODER_COVARIANCE_FIXED,
                                         v1::DECODER_COVARIANCE_LEARNED,
                                         v1::DECODER_COVARIANCE_PREDICTED,
                                         v1::DECODER_COVARIANCE_SCENE),
                         [](const auto& each) { return v1::DecoderCovariance_Name(each.param); });

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
  const LaterPhases later = anchors.Rehearsed();
  for (const RehearsedPhase& phase : later.learned) {
    names.push_back(phase.name);
    const std::optional<double> step = RehearseForReal(phase, state_);
    ASSERT_TRUE(step) << phase.name;
    EXPECT_GT(*step, 0.0) << phase.name;
  }
  for (const RehearsedCalibration& calibration : later.calibrated) {
    names.push_back(calibration.name);
    CalibrationPlan taken;
    ASSERT_TRUE(calibration
                    .calibrate(calibration.examples,
                               [&taken](CalibrationStep kind, int64_t) {
                                 ++taken[static_cast<size_t>(kind)].count;
                               })
                    .ok());
    for (size_t kind = 0; kind < kCalibrationStepKinds; ++kind) {
      EXPECT_EQ(taken[kind].count, calibration.steps[kind].count)
          << calibration.name << " " << kind;
    }
  }
  EXPECT_EQ(names, (std::vector<std::string>{"covernet", "multipath", "calibrate covernet",
                                             "calibrate multipath"}));
  for (const auto& [name, tensor] : before) {
    EXPECT_TRUE(at::equal(state_.networks[name], tensor)) << name;
  }
}

class ExportRehearsalTest : public testing::Test {
 protected:
  ExportRehearsalTest() { options_.output = folder_ / "model"; }

  // A second passes whenever the clock is asked.
  std::optional<ExportSeconds> Rehearse(const ExportOptions& options) {
    LearningState state(settings_, data_, at::Device(at::kCPU), 1, [] { return false; });
    artifact::StoredModel model{{}, state.networks.Export()};
    *model.manifest.mutable_spec() = settings_.model();
    return RehearseExport(std::move(model), data_, settings_.examples(), options, [] {
      Pass(1.0);
      return now;
    });
  }

  static v1::TrainingSettings Settings() {
    v1::TrainingSettings settings = TinySettings();
    settings.mutable_examples()->mutable_stride()->set_nanos(100'000'000);
    return settings;
  }

  const TemporaryFolder folder_;
  const v1::TrainingSettings settings_ = Settings();
  TrainingData data_ = *SplitRecordings(ArcRecordings(72), settings_);
  ExportOptions options_;
};

TEST_F(ExportRehearsalTest, MeasuresAFewExamplesAndTellsHowLongAllTake) {
  const size_t all = data_.validation.examples.size();
  ASSERT_EQ(all, 16U * 36U);  // of 16 recordings
  const std::optional<ExportSeconds> seconds = Rehearse(options_);
  ASSERT_TRUE(seconds);
  EXPECT_DOUBLE_EQ(seconds->write, 1.0);
  // The evaluation reports every 64 examples.
  EXPECT_DOUBLE_EQ(seconds->measure, static_cast<double>(all) / 64.0);
  // It measures eight recordings and so reports four times. The clock is asked twice more.
  EXPECT_DOUBLE_EQ(seconds->finish, 6.0 - 8 * 36 / 64.0);
  EXPECT_TRUE(folder_.Names().empty());
}

TEST_F(ExportRehearsalTest, MeasuresNothingOfFewExamplesOrIfTheRunStops) {
  options_.progress = [](int64_t, int64_t) { return false; };
  EXPECT_FALSE(Rehearse(options_));
  options_.progress = nullptr;
  EXPECT_TRUE(Rehearse(options_));
  data_.validation.examples.resize(255);
  EXPECT_FALSE(Rehearse(options_));
  EXPECT_TRUE(folder_.Names().empty());
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

// Seconds that a phase of the quickstart's training took.
struct Took {
  std::string phase;
  double seconds = 0.0;  // of its first kind of steps
  int64_t steps = 0;
  std::vector<double> others = {};  // of its other kinds, which follow one another
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

double ToSeconds(const google::protobuf::Duration& duration) {
  return static_cast<double>(duration.seconds()) + 1e-9 * duration.nanos();
}

// Runs the plan in the time that its phases took. Expects every report after a tenth of it to be
// right, within a quarter, about the time that is left.
void ExpectTheTimeLeftToBeRight(const std::vector<TrainingProgress::Phase>& plan,
                                const MeasuredSteps& rehearsed, const std::vector<Took>& took) {
  double whole = 0.0;
  for (const Took& each : took) {
    whole += std::accumulate(each.others.begin(), each.others.end(), each.seconds);
  }
  now = {};
  int reports = 0;
  TrainingProgress progress(
      plan,
      [&](const v1::JobProgress& each) {
        const double passed = std::chrono::duration<double>(now.time_since_epoch()).count();
        if (passed < 0.1 * whole) return;
        ++reports;
        const double left = whole - passed;
        const double told = ToSeconds(each.time_left());
        EXPECT_NEAR(told, left, 0.25 * left + 0.05) << each.phase() << " " << each.step();
        EXPECT_NEAR(each.fraction(), passed / whole, 0.1) << each.phase() << " " << each.step();
      },
      [] { return now; });
  progress.Replan(WithMeasuredSteps(plan, rehearsed), /*in_seconds=*/true);
  for (const Took& each : took) {
    const auto planned = std::ranges::find(plan, each.phase, &TrainingProgress::Phase::name);
    ASSERT_NE(planned, plan.end()) << each.phase;
    if (each.steps > 0) {
      EXPECT_EQ(planned->steps, each.steps) << each.phase;
    }
    if (planned->seconds) continue;  // after the run
    progress.BeginPhase(each.phase);
    ASSERT_EQ(planned->others.size(), each.others.size()) << each.phase;
    for (size_t kind = 0; kind <= each.others.size(); ++kind) {
      const double seconds = kind == 0 ? each.seconds : each.others[kind - 1];
      const int64_t steps = kind == 0 ? planned->steps : planned->others[kind - 1].count;
      for (int64_t step = 0; step < steps; ++step) {
        Pass(seconds / static_cast<double>(steps));
        progress.Step(1, {}, kind);
      }
    }
  }
  EXPECT_GT(reports, whole);  // at least one a second
}

TEST(TimeLeftTest, IsWithinAQuarterFromATenthOfTheTimeOn) {
  // Processor time of one thread, on a town of 240 recordings.
  ExpectTheTimeLeftToBeRight(Learner::Plan(QuickstartSettings(), {30'000, 30'000, 1770}),
                             {{"pretrain", {3.5 / 1440}},
                              {"joint", {25.5 / 376}},
                              {"covariance", {5.0 / 141}},
                              {"calibrate", {0.5 / 92, 1.0 / 56, 5.0 / 60, 0.0}},
                              {"export", {0.1}},
                              {"evaluate", {0.9 / 100, 0.2}}},
                             {{"load", 2.2, 1},
                              {"pretrain", 3.5, 1440},
                              {"mixture", 5.5, 1440},
                              {"joint", 25.5, 376},
                              {"covariance", 5.0, 141},
                              {"calibrate", 0.5, 92, {1.0, 5.0, 0.0}},
                              {"export", 0.1, 1},
                              {"evaluate", 0.9, 100, {0.2}}});
}

TEST(TimeLeftTest, IsWithinAQuarterWhereCalibrationHasAnotherShare) {
  // Two threads on two idle cores: the fits of calibration gain more from them than the rest.
  ExpectTheTimeLeftToBeRight(Learner::Plan(QuickstartSettings(), {30'000, 30'000, 1770}),
                             {{"pretrain", {3.6 / 1440}},
                              {"joint", {18.2 / 376}},
                              {"covariance", {3.4 / 141}},
                              {"calibrate", {0.4 / 92, 0.8 / 56, 2.6 / 60, 0.0}},
                              {"export", {0.1}},
                              {"evaluate", {0.4 / 100, 0.1}}},
                             {{"load", 2.0, 1},
                              {"pretrain", 3.6, 1440},
                              {"mixture", 5.0, 1440},
                              {"joint", 18.2, 376},
                              {"covariance", 3.4, 141},
                              {"calibrate", 0.4, 92, {0.8, 2.6, 0.0}},
                              {"export", 0.1, 1},
                              {"evaluate", 0.4, 100, {0.1}}});
}

TEST(TimeLeftTest, CountsBaselinesTheirCalibrationAndWhatFollowsTheRun) {
  const v1::TrainingSettings settings = QuickstartSettings();
  std::vector<TrainingProgress::Phase> plan = Learner::Plan(settings, {30'000, 30'000, 1770});
  AnchorLearner::AddPhases(settings, {30'000, 30'000, 1770}, &plan);
  plan.push_back({"after", 1, 1, 9'999.0, 20.0});
  // Processor time of one thread, on the same town.
  ExpectTheTimeLeftToBeRight(plan,
                             {{"pretrain", {3.4 / 1440}},
                              {"joint", {22.1 / 376}},
                              {"covariance", {4.4 / 141}},
                              {"covernet", {4.3 / 376}},
                              {"multipath", {10.6 / 376}},
                              {"calibrate", {0.5 / 92, 1.0 / 56, 4.5 / 60, 0.0}},
                              {"calibrate covernet", {0.4 / 120, 0.0, 1.1 / 64, 1.3 / 80}},
                              {"calibrate multipath", {0.45 / 56, 0.0, 0.0, 1.3 / 80}},
                              {"export", {0.1}},
                              {"evaluate", {1.4 / 100, 0.2}}},
                             {{"load", 2.8, 1},
                              {"pretrain", 3.4, 1440},
                              {"mixture", 5.2, 1440},
                              {"joint", 22.1, 376},
                              {"covariance", 4.4, 141},
                              {"calibrate", 0.5, 92, {1.0, 4.5, 0.0}},
                              {"covernet", 4.3, 376},
                              {"calibrate covernet", 0.4, 120, {0.0, 1.1, 1.3}},
                              {"multipath", 10.6, 376},
                              {"calibrate multipath", 0.45, 56, {0.0, 0.0, 1.3}},
                              {"export", 0.1, 1},
                              {"evaluate", 1.4, 100, {0.2}},
                              {"after", 20.0, 1}});
}

}  // namespace
}  // namespace maneuver::learning::rehearsal_test
