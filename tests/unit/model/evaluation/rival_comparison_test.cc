#include "model/evaluation/rival_comparison.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <utility>

#include "model/evaluation/cross_validation_report.h"
#include "model/evaluation/measured_set.h"
#include "model/evaluation/rival_table.h"

namespace maneuver::evaluation::rival_comparison_test {
namespace {

constexpr int kRecordings = 120;

// Returns a standard normal number, always the same for a recording.
double NormalOf(int recording) {
  std::mt19937_64 random(static_cast<uint64_t>(recording));
  random.discard(10);
  return std::normal_distribution<double>()(random);
}

data::RecordingGroups GroupsOf(int recordings, int recordings_a_group) {
  data::RecordingGroups groups;
  for (int i = 0; i < recordings; ++i) {
    groups.ids.push_back(std::to_string(i));
    groups.groups.push_back(i / recordings_a_group);
  }
  groups.count = groups.groups.back() + 1;
  return groups;
}

// ADE 2 for the model and the faded roll-out; the others have this much more.
Measurement MeasuredAs(double speed, double cv_more, double ctra_more) {
  Measurement measured;
  measured.probabilities = Eigen::Vector2d(0.75, 0.25);
  measured.responsibilities = Eigen::Vector2d(1.0, 0.0);
  measured.posterior.displacement[0].min_ade = 2.0;
  measured.constant_velocity.displacement.min_ade = 2.0 + cv_more;
  measured.constant_turn.displacement.min_ade = 2.0 + ctra_more;
  measured.faded.displacement.min_ade = 2.0;
  measured.keys.speed = speed;
  measured.keys.kinematic_class = KinematicClass::kStraightFast;
  return measured;
}

// Recording i has i % 3 + 1 examples, the last one at 7 m/s and the others at 12 m/s. Constant
// velocity is worse by 1 + n / 2, where n is normal and specific to the recording. CTRA is 1 better
// at 7 m/s and 2 worse at 12 m/s. The faded roll-out equals the model.
MeasuredExamples Measure() {
  MeasuredExamples all;
  for (int i = 0; i < kRecordings; ++i) {
    for (int j = 0; j <= i % 3; ++j) {
      const bool slow = j == i % 3;
      all.examples.emplace_back().recording = i;
      all.measured.push_back(
          MeasuredAs(slow ? 7.0 : 12.0, 1.0 + 0.5 * NormalOf(i), slow ? -1.0 : 2.0));
    }
  }
  return all;
}

v1::RivalStandings StandingsOf(const MeasuredExamples& measured,
                               const data::RecordingGroups& groups,
                               const BootstrapOptions& options = {}) {
  RivalSums sums(groups, measured.measured_by_waymo);
  for (size_t i = 0; i < measured.examples.size(); ++i) {
    sums.Add(static_cast<size_t>(measured.examples[i].recording), measured.measured[i]);
  }
  return sums.MakeStandings(options);
}

const v1::RivalComparison& Of(const v1::RivalStanding& part, const std::string& rival,
                              const std::string& metric = "ade_1") {
  for (const v1::RivalComparison& each : part.comparisons()) {
    if (each.rival() == rival && each.metric() == metric) return each;
  }
  ADD_FAILURE() << "no " << rival << " by " << metric;
  return v1::RivalComparison::default_instance();
}

TEST(RivalComparisonTest, SaysWhereTheModelIsAheadBehindAndUndecided) {
  const v1::RivalStandings standings = StandingsOf(Measure(), GroupsOf(kRecordings, 1));
  EXPECT_EQ(standings.recordings(), kRecordings);
  EXPECT_EQ(standings.groups(), kRecordings);
  EXPECT_EQ(standings.largest_group(), 1);
  EXPECT_EQ(standings.resamples(), 1000);
  ASSERT_EQ(standings.parts_size(), 4);
  const v1::RivalStanding& all = standings.parts(0);
  EXPECT_EQ(all.dimension(), "");
  EXPECT_EQ(all.examples(), 2 * kRecordings);
  EXPECT_EQ(Of(all, "cv").verdict(), v1::RIVAL_VERDICT_AHEAD);
  EXPECT_EQ(Of(all, "cv").rival_metric(), "ade_cv");
  EXPECT_EQ(Of(all, "cv").difference().seed_values_size(), 0);
  // Half of the examples are 1 m worse, half 2 m better.
  EXPECT_DOUBLE_EQ(Of(all, "ctra").difference().value(), -0.5);
  EXPECT_EQ(Of(all, "faded").verdict(), v1::RIVAL_VERDICT_UNDECIDED);

  const v1::RivalStanding& slow = standings.parts(1);
  EXPECT_EQ(slow.dimension(), "speed");
  EXPECT_EQ(slow.name(), "5-10 m/s");
  EXPECT_EQ(slow.examples(), kRecordings);
  EXPECT_EQ(Of(slow, "ctra").verdict(), v1::RIVAL_VERDICT_BEHIND);
  EXPECT_EQ(Of(slow, "ctra").difference().lower(), 1.0);
  const v1::RivalStanding& fast = standings.parts(2);
  EXPECT_EQ(fast.name(), "10-15 m/s");
  EXPECT_EQ(fast.groups(), kRecordings * 2 / 3);
  EXPECT_EQ(Of(fast, "ctra").verdict(), v1::RIVAL_VERDICT_AHEAD);
  EXPECT_EQ(standings.parts(3).dimension(), "class");
  EXPECT_EQ(standings.parts(3).name(), "straight_fast");
}

// By the delta method, a ratio of sums over independent groups has the variance
//   sum_g m_g^2 (x_g - mean)^2 / (sum_g m_g)^2
// with m_g examples of mean value x_g in group g. Two recordings of a group are drawn together.
TEST(RivalComparisonTest, IntervalsMatchTheDeltaMethodOverGroups) {
  for (const int size : {1, 2}) {
    SCOPED_TRACE(size);
    const v1::RivalStandings standings =
        StandingsOf(Measure(), GroupsOf(kRecordings, size), {.resamples = 4000});
    const v1::Estimate& difference = Of(standings.parts(0), "cv").difference();
    double sum = 0.0;
    double examples = 0.0;
    for (int i = 0; i < kRecordings; ++i) {
      sum -= (i % 3 + 1) * (1.0 + 0.5 * NormalOf(i));
      examples += i % 3 + 1;
    }
    EXPECT_NEAR(difference.value(), sum / examples, 1e-12);
    double squares = 0.0;
    for (int first = 0; first < kRecordings; first += size) {
      double deviation = 0.0;
      for (int i = first; i < first + size; ++i) {
        deviation += (i % 3 + 1) * (-1.0 - 0.5 * NormalOf(i) - difference.value());
      }
      squares += deviation * deviation;
    }
    const double half = 1.96 * std::sqrt(squares) / examples;
    EXPECT_NEAR(difference.lower(), difference.value() - half, 0.12 * half);
    EXPECT_NEAR(difference.upper(), difference.value() + half, 0.12 * half);
  }
}

// One model measures all recordings, as the only fold of a cross-validation.
TEST(RivalComparisonTest, AgreesWithCrossValidationOfTheSameExamples) {
  const MeasuredExamples all = Measure();
  const data::RecordingGroups groups = GroupsOf(kRecordings, 2);
  v1::CrossValidationPart whole;
  whole.mutable_plan()->set_folds(1);
  whole.mutable_plan()->add_seeds(3);
  std::vector<int> numbers;
  for (int i = 0; i < kRecordings; ++i) {
    whole.mutable_plan()->add_recordings()->set_group(groups.groups[static_cast<size_t>(i)]);
    numbers.push_back(i);
  }
  v1::FoldRun& run = *whole.add_runs();
  run.set_seed(3);
  MeasuredSetBuilder set(groups.groups);
  set.Add(all, numbers);
  *run.mutable_held_out() = std::move(set).Build();
  const v1::CrossValidationReport report = MakeCrossValidationReport(whole, {});
  const v1::RivalStandings standings = StandingsOf(all, groups);

  ASSERT_EQ(report.sets_size(), 1);
  const auto& theirs = report.sets(0).overall().comparisons();
  const auto& ours = standings.parts(0).comparisons();
  ASSERT_EQ(ours.size(), theirs.size());
  EXPECT_EQ(ours.size(), 4 * 3);  // ade_1, fde_1, miss_rate_1 and ade_medoid; no trained rivals
  for (int i = 0; i < ours.size(); ++i) {
    EXPECT_EQ(ours[i].metric() + ours[i].rival(), theirs[i].metric() + theirs[i].rival());
    EXPECT_DOUBLE_EQ(ours[i].difference().value(), theirs[i].difference().value());
    EXPECT_DOUBLE_EQ(ours[i].difference().lower(), theirs[i].difference().lower());
    EXPECT_DOUBLE_EQ(ours[i].difference().upper(), theirs[i].difference().upper());
    EXPECT_EQ(ours[i].verdict(), theirs[i].verdict());
  }
}

TEST(RivalComparisonTest, FewGroupsDecideNothing) {
  const v1::RivalStandings five = StandingsOf(Measure(), GroupsOf(kRecordings, 24));
  EXPECT_EQ(five.groups(), 5);
  EXPECT_LT(Of(five.parts(0), "cv").difference().upper(), 0.0);
  EXPECT_EQ(Of(five.parts(0), "cv").verdict(), v1::RIVAL_VERDICT_UNDECIDED);
  const v1::RivalStandings six = StandingsOf(Measure(), GroupsOf(kRecordings, 20));
  EXPECT_EQ(Of(six.parts(0), "cv").verdict(), v1::RIVAL_VERDICT_AHEAD);
}

TEST(RivalComparisonTest, DoesNotComparePartsWithFewExamples) {
  MeasuredExamples all = Measure();
  all.measured[0].keys.speed = 20.0;
  const v1::RivalStandings standings = StandingsOf(all, GroupsOf(kRecordings, 1));
  const v1::RivalStanding& fastest = standings.parts(3);
  EXPECT_EQ(fastest.name(), ">=15 m/s");
  EXPECT_EQ(fastest.examples(), 1);
  EXPECT_EQ(fastest.comparisons_size(), 0);
}

TEST(RivalComparisonTest, ComparesTrainedBaselinesByTheirBestSixToo) {
  MeasuredExamples all = Measure();
  for (Measurement& each : all.measured) {
    each.posterior.displacement[2].min_fde = 1.0;
    AnchorMeasurement anchors;
    anchors.displacement[2].min_fde = 3.0;
    each.covernet = anchors;
    anchors.displacement[2].min_fde = 0.5;
    each.multipath = anchors;
  }
  const v1::RivalStandings standings = StandingsOf(all, GroupsOf(kRecordings, 1));
  const v1::RivalStanding& part = standings.parts(0);
  EXPECT_EQ(part.comparisons_size(), 4 * 3 + 7 * 2);
  EXPECT_EQ(Of(part, "covernet", "min_fde_6").rival_metric(), "covernet_min_fde_6");
  EXPECT_DOUBLE_EQ(Of(part, "covernet", "min_fde_6").difference().value(), -2.0);
  EXPECT_EQ(Of(part, "covernet", "min_fde_6").verdict(), v1::RIVAL_VERDICT_AHEAD);
  EXPECT_DOUBLE_EQ(Of(part, "multipath", "min_fde_6").difference().value(), 0.5);
  EXPECT_EQ(Of(part, "multipath", "min_fde_6").verdict(), v1::RIVAL_VERDICT_BEHIND);
}

}  // namespace
}  // namespace maneuver::evaluation::rival_comparison_test
