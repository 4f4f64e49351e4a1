// Parts, report and text of cross-validations, on measurements given by formulas.

#include <gmock/gmock.h>
#include <google/protobuf/util/message_differencer.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "model/evaluation/cross_validation_parts.h"
#include "model/evaluation/cross_validation_report.h"
#include "model/evaluation/cross_validation_text.h"

namespace maneuver::evaluation::cross_validation_test {
namespace {

using testing::HasSubstr;

constexpr int kRecordings = 200;
constexpr int kFolds = 2;

// Recordings i, each a group of its own, in fold i % 2.
v1::CrossValidationPlan Plan() {
  v1::CrossValidationPlan plan;
  plan.set_folds(kFolds);
  plan.set_fold_seed(1);
  for (int i = 0; i < kRecordings; ++i) {
    v1::GroupedRecording& recording = *plan.add_recordings();
    recording.set_scenario_id(std::to_string(i));
    recording.set_group(i);
    recording.set_fold(i % kFolds);
  }
  return plan;
}

v1::MeasuredSet EmptySet() {
  v1::MeasuredSet set;
  for (const char* name : {"ade_1", "ade_cv", "ade_ctra"}) set.add_value_names(name);
  v1::StratumDimension& dimension = *set.add_dimensions();
  dimension.set_dimension("speed");
  dimension.add_names("slow");
  dimension.add_names("fast");
  return set;
}

void AddExample(v1::MeasuredSet& set, int recording, double ade, double cv, double ctra,
                int stratum) {
  v1::MeasuredExample& example = *set.add_examples();
  example.set_recording(recording);
  for (const double value : {ade, cv, ctra}) example.add_values(value);
  example.add_strata(stratum);
  example.set_confidence(0.75);
  example.set_responsibility(recording % 2 == 0 ? 1.0 : 0.0);
}

// Returns a standard normal number, always the same for a recording.
double NormalOf(int recording) {
  std::mt19937_64 random(static_cast<uint64_t>(recording));
  random.discard(10);
  return std::normal_distribution<double>()(random);
}

// Recording i has i % 3 + 1 equal examples, the last of them fast. ADE is 2 + 0.5 n, where n is
// normal and specific to the recording, plus the seed's offset. Constant velocity is 3 worse, give
// or take a tenth of a normal number. CTRA is 0.5 worse or better, alternating every six
// recordings.
v1::FoldRun MakeRun(int64_t seed, int fold) {
  v1::FoldRun run;
  run.set_seed(seed);
  run.set_fold(fold);
  *run.mutable_held_out() = EmptySet();
  for (int i = 0; i < kRecordings; ++i) {
    if (i % kFolds != fold) {
      run.add_learned(i);
      continue;
    }
    const double ade = 2.0 + 0.5 * NormalOf(i) + 0.01 * static_cast<double>(seed);
    for (int j = 0; j <= i % 3; ++j) {
      AddExample(*run.mutable_held_out(), i, ade, ade + 3.0 + 0.1 * NormalOf(i + 1000),
                 ade + (i / 6 % 2 == 0 ? 0.5 : -0.5), j == i % 3 ? 1 : 0);
    }
  }
  (*run.mutable_held_out()->mutable_set_metrics())["mutual_information"] =
      1.0 + fold + 0.1 * static_cast<double>(seed);
  return run;
}

v1::CrossValidationPart Part(const std::vector<std::pair<int64_t, int>>& runs) {
  v1::CrossValidationPart part;
  *part.mutable_plan() = Plan();
  for (const auto& [seed, fold] : runs) {
    part.mutable_plan()->add_seeds(seed);
    *part.add_runs() = MakeRun(seed, fold);
  }
  return part;
}

std::string MergeError(std::vector<v1::CrossValidationPart> parts, absl::StatusCode code) {
  const absl::Status status = MergeParts(std::move(parts)).status();
  EXPECT_EQ(status.code(), code) << status;
  return std::string(status.message());
}

TEST(CrossValidationPartsTest, PartsInAnyOrderGiveTheSameWhole) {
  const auto all = MergeParts({Part({{1, 0}, {1, 1}, {2, 0}, {2, 1}})});
  ASSERT_TRUE(all.ok()) << all.status();
  const auto merged = MergeParts({Part({{2, 1}}), Part({{1, 1}, {2, 0}}), Part({{1, 0}})});
  ASSERT_TRUE(merged.ok()) << merged.status();
  EXPECT_THAT(merged->plan().seeds(), testing::ElementsAre(1, 2));
  EXPECT_TRUE(google::protobuf::util::MessageDifferencer::Equals(*all, *merged));
}

TEST(CrossValidationPartsTest, RefusesMissingRepeatedAndForeignRuns) {
  using enum absl::StatusCode;
  EXPECT_THAT(MergeError({Part({{1, 0}})}, kFailedPrecondition),
              HasSubstr("seed 1 lacks fold 2 of 2; run it with --only-fold 2 --seeds 1"));
  EXPECT_THAT(MergeError({Part({{1, 0}, {1, 1}}), Part({{1, 0}})}, kFailedPrecondition),
              HasSubstr("two parts have seed 1, fold 1"));
  v1::CrossValidationPart other = Part({{1, 1}});
  other.mutable_plan()->set_fold_seed(2);
  EXPECT_THAT(MergeError({Part({{1, 0}}), other}, kFailedPrecondition),
              HasSubstr("different cross-validations"));
  other = Part({{1, 1}});
  other.mutable_runs(0)->mutable_held_out()->set_value_names(2, "ade_other");
  EXPECT_THAT(MergeError({Part({{1, 0}}), other}, kFailedPrecondition),
              HasSubstr("different metrics"));
  other = Part({{1, 1}});
  v1::MeasuredSet& measured = *other.mutable_runs(0)->mutable_held_out();
  v1::StratumDimension& type = *measured.add_dimensions();
  type.set_dimension("type");
  type.add_names("vehicle");
  for (v1::MeasuredExample& example : *measured.mutable_examples()) example.add_strata(0);
  EXPECT_THAT(MergeError({Part({{1, 0}}), other}, kFailedPrecondition),
              HasSubstr("different metrics or strata"));
}

TEST(CrossValidationPartsTest, RefusesAModelThatLearnedFromTheGroupItIsMeasuredOn) {
  using enum absl::StatusCode;
  v1::CrossValidationPart part = Part({{1, 0}, {1, 1}});
  part.mutable_plan()->mutable_recordings(5)->set_group(8);  // of the other fold
  EXPECT_THAT(MergeError({part}, kDataLoss), HasSubstr("learned from its group"));
  part = Part({{1, 0}, {1, 1}});
  part.mutable_runs(0)->add_learned(4);
  EXPECT_THAT(MergeError({part}, kDataLoss), HasSubstr("recording 4 was measured"));
}

TEST(CrossValidationPartsTest, RefusesDamagedParts) {
  using enum absl::StatusCode;
  v1::CrossValidationPart part = Part({{1, 0}, {1, 1}});
  part.mutable_runs(0)->mutable_held_out()->mutable_examples(0)->set_recording(kRecordings);
  MergeError({part}, kDataLoss);
  part = Part({{1, 0}, {1, 1}});
  part.mutable_runs(0)->mutable_held_out()->mutable_examples(0)->set_strata(0, 2);
  MergeError({part}, kDataLoss);
  part = Part({{1, 0}, {1, 1}});
  part.mutable_runs(0)->mutable_held_out()->mutable_examples(0)->mutable_values()->RemoveLast();
  MergeError({part}, kDataLoss);
  part = Part({{1, 0}, {1, 1}});
  part.mutable_runs(0)->set_learned(0, -1);
  MergeError({part}, kDataLoss);
  for (const double confidence : {std::nan(""), -5.0, 1.5}) {
    part = Part({{1, 0}, {1, 1}});
    part.mutable_runs(0)->mutable_held_out()->mutable_examples(0)->set_confidence(confidence);
    EXPECT_THAT(MergeError({part}, kDataLoss), HasSubstr("probability"));
  }
  part = Part({{1, 0}, {1, 1}});
  part.mutable_runs(0)->mutable_held_out()->mutable_examples(0)->set_values(0, HUGE_VAL);
  EXPECT_THAT(MergeError({part}, kDataLoss), HasSubstr("is not finite"));
}

class CrossValidationReportTest : public testing::Test {
 protected:
  CrossValidationReportTest() {
    const auto whole = MergeParts({Part({{1, 0}, {1, 1}, {3, 0}, {3, 1}})});
    report_ = MakeCrossValidationReport(*whole, {.resamples = 2000});
  }
  const v1::CrossValidatedSet& set() const { return report_.sets(0); }

  v1::CrossValidationReport report_;
};

TEST_F(CrossValidationReportTest, MeansAreOverTheExamplesOfAllFolds) {
  double sum = 0.0;
  int examples = 0;
  for (int i = 0; i < kRecordings; ++i) {
    sum += (i % 3 + 1) * (2.0 + 0.5 * NormalOf(i));
    examples += i % 3 + 1;
  }
  const v1::Estimate& ade = set().overall().metrics().at("ade_1");
  EXPECT_EQ(set().overall().examples(), examples);
  EXPECT_EQ(set().recordings(), kRecordings);
  EXPECT_EQ(set().groups(), kRecordings);
  EXPECT_EQ(set().largest_group(), 1);
  EXPECT_NEAR(ade.value(), sum / examples + 0.02, 1e-12);
  EXPECT_NEAR(ade.seed_values(0), sum / examples + 0.01, 1e-12);
  EXPECT_NEAR(ade.seed_values(1), sum / examples + 0.03, 1e-12);
}

// The mean is a ratio of sums over independent groups. By the delta method its variance is
//   sum_g m_g^2 (x_g - mean)^2 / (sum_g m_g)^2
// with m_g examples of value x_g in group g.
TEST_F(CrossValidationReportTest, IntervalsMatchTheDeltaMethodOverGroups) {
  const v1::Estimate& ade = set().overall().metrics().at("ade_1");
  double squares = 0.0;
  double examples = 0.0;
  for (int i = 0; i < kRecordings; ++i) {
    const double m = i % 3 + 1;
    squares += std::pow(m * (2.02 + 0.5 * NormalOf(i) - ade.value()), 2);
    examples += m;
  }
  const double half = 1.96 * std::sqrt(squares) / examples;
  EXPECT_NEAR(ade.lower(), ade.value() - half, 0.12 * half);
  EXPECT_NEAR(ade.upper(), ade.value() + half, 0.12 * half);
}

TEST_F(CrossValidationReportTest, RatiosAreOfMeans) {
  const auto& metrics = set().overall().metrics();
  const v1::Estimate& ratio = metrics.at("ade_ratio");
  const double of_means = metrics.at("ade_1").value() / metrics.at("ade_cv").value();
  EXPECT_NEAR(ratio.value(), of_means, 1e-4);  // the mean of two seeds' ratios
  EXPECT_LT(ratio.lower(), of_means);
  EXPECT_GT(ratio.upper(), of_means);
  EXPECT_FALSE(metrics.contains("fde_ratio"));
}

// p is 0.75 everywhere; the even recordings, with half of the examples, have q = 1.
TEST_F(CrossValidationReportTest, TheCalibrationErrorCoversAllFolds) {
  double right = 0.0;
  double examples = 0.0;
  for (int i = 0; i < kRecordings; ++i) {
    right += i % 2 == 0 ? i % 3 + 1 : 0;
    examples += i % 3 + 1;
  }
  EXPECT_NEAR(set().overall().metrics().at("calibration_error").value(),
              std::abs(0.75 - right / examples), 1e-12);
}

// The error is |0.75 - q| with the mean q over the examples, so the delta method gives its variance
// as that of a mean.
TEST_F(CrossValidationReportTest, TheCalibrationErrorsIntervalMatchesTheDeltaMethod) {
  double right = 0.0;
  double examples = 0.0;
  for (int i = 0; i < kRecordings; ++i) {
    right += i % 2 == 0 ? i % 3 + 1 : 0;
    examples += i % 3 + 1;
  }
  double squares = 0.0;
  for (int i = 0; i < kRecordings; ++i) {
    squares += std::pow((i % 3 + 1) * ((i % 2 == 0 ? 1.0 : 0.0) - right / examples), 2);
  }
  const double half = 1.96 * std::sqrt(squares) / examples;
  const v1::Estimate& error = set().overall().metrics().at("calibration_error");
  EXPECT_NEAR(error.lower(), error.value() - half, 0.02 * half);
  EXPECT_NEAR(error.upper(), error.value() + half, 0.02 * half);
}

// Predictions that are right as often as they say, so that the calibration error is noise.
TEST(CrossValidationIntervalTest, NoiseDoesNotShiftTheIntervalOfTheCalibrationError) {
  constexpr int kDataSets = 50;
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  double values = 0.0;
  double middles = 0.0;
  for (int i = 0; i < kDataSets; ++i) {
    v1::CrossValidationPart part = Part({{1, 0}, {1, 1}});
    for (v1::FoldRun& run : *part.mutable_runs()) {
      run.mutable_held_out()->clear_examples();
      for (int j = run.fold(); j < kRecordings; j += kFolds) {
        AddExample(*run.mutable_held_out(), j, 1.0, 1.0, 1.0, 0);
        v1::MeasuredExample& example = *run.mutable_held_out()->mutable_examples()->rbegin();
        example.set_confidence(uniform(random));
        example.set_responsibility(uniform(random) < example.confidence() ? 1.0 : 0.0);
      }
    }
    const auto whole = MergeParts({part});
    ASSERT_TRUE(whole.ok()) << whole.status();
    const v1::CrossValidationReport report = MakeCrossValidationReport(*whole, {.resamples = 100});
    const v1::Estimate& error = report.sets(0).overall().metrics().at("calibration_error");
    values += error.value() / kDataSets;
    middles += 0.5 * (error.lower() + error.upper()) / kDataSets;
  }
  EXPECT_NEAR(middles, values, 0.05 * values);
}

TEST_F(CrossValidationReportTest, PairedIntervalsDecideWhereTheModelIsAhead) {
  ASSERT_EQ(set().overall().comparisons_size(), 2);
  const v1::RivalComparison& cv = set().overall().comparisons(0);
  EXPECT_EQ(cv.rival(), "cv");
  EXPECT_EQ(cv.rival_metric(), "ade_cv");
  EXPECT_EQ(cv.verdict(), v1::RIVAL_VERDICT_AHEAD);
  // Paired: what both share cancels.
  EXPECT_NEAR(cv.difference().value(), -3.0, 0.03);
  EXPECT_LT(cv.difference().upper() - cv.difference().lower(), 0.05);
  EXPECT_EQ(set().overall().comparisons(1).verdict(), v1::RIVAL_VERDICT_UNDECIDED);
}

TEST_F(CrossValidationReportTest, StrataPartitionTheExamples) {
  ASSERT_EQ(set().strata_size(), 2);
  EXPECT_EQ(set().strata(0).name(), "slow");
  EXPECT_EQ(set().strata(1).name(), "fast");
  EXPECT_EQ(set().strata(0).examples() + set().strata(1).examples(), set().overall().examples());
  EXPECT_EQ(set().strata(1).examples(), kRecordings);
  // Recordings 0, 3, 6, ... have no slow example.
  EXPECT_EQ(set().strata(0).groups(), 133);
}

// Recordings 0 to 59 are of the first dataset: 20 of one example, 20 of two and 20 of three.
TEST(CrossValidationDatasetsTest, HeldOutFoldsAreDividedByDataset) {
  v1::CrossValidationPart part = Part({{1, 0}, {1, 1}});
  for (const char* name : {"city", "motorway"}) part.mutable_plan()->add_dataset_names(name);
  for (int i = 60; i < kRecordings; ++i) part.mutable_plan()->mutable_recordings(i)->set_dataset(1);
  const auto whole = MergeParts({part});
  ASSERT_TRUE(whole.ok()) << whole.status();
  const auto report = MakeCrossValidationReport(*whole, {.resamples = 100});
  std::vector<v1::CrossValidatedPart> datasets;
  for (const v1::CrossValidatedPart& stratum : report.sets(0).strata()) {
    if (stratum.dimension() == "dataset") datasets.push_back(stratum);
  }
  ASSERT_EQ(datasets.size(), 2u);
  EXPECT_EQ(datasets[0].name(), "city");
  EXPECT_EQ(datasets[0].groups(), 60);
  EXPECT_EQ(datasets[0].examples(), 120);
  EXPECT_EQ(datasets[1].name(), "motorway");
  EXPECT_EQ(datasets[1].groups(), kRecordings - 60);
  double sum = 0.0;
  for (int i = 0; i < 60; ++i) sum += (i % 3 + 1) * (2.01 + 0.5 * NormalOf(i));
  EXPECT_NEAR(datasets[0].metrics().at("ade_1").value(), sum / 120, 1e-12);
  const std::string text = CrossValidationText(report, false);
  EXPECT_THAT(text, HasSubstr("BY DATASET"));
  EXPECT_THAT(text, HasSubstr("\nmotorway "));
}

TEST(CrossValidationDatasetsTest, OneDatasetIsNoStratum) {
  v1::CrossValidationPart part = Part({{1, 0}, {1, 1}});
  part.mutable_plan()->add_dataset_names("city");
  const auto whole = MergeParts({part});
  ASSERT_TRUE(whole.ok()) << whole.status();
  const auto report = MakeCrossValidationReport(*whole, {.resamples = 100});
  EXPECT_EQ(report.sets(0).strata_size(), 2);  // slow and fast
  EXPECT_EQ(CrossValidationText(report, false).find("BY DATASET"), std::string::npos);
}

TEST(CrossValidationDatasetsTest, PartsOfMachinesThatNameADatasetDifferentlyMerge) {
  v1::CrossValidationPart one = Part({{1, 0}});
  v1::CrossValidationPart other = Part({{1, 1}});
  one.mutable_plan()->add_dataset_names("city");
  other.mutable_plan()->add_dataset_names("town");
  const auto whole = MergeParts({one, other});
  ASSERT_TRUE(whole.ok()) << whole.status();
  EXPECT_EQ(whole->plan().dataset_names(0), "city");
  // As an older program writes it: no names, and every recording of dataset 0.
  v1::CrossValidationPart older = Part({{1, 1}});
  one.mutable_plan()->add_dataset_names("motorway");
  one.mutable_plan()->mutable_recordings(3)->set_dataset(1);
  EXPECT_TRUE(SamePlan(one.plan(), older.plan()));
  EXPECT_TRUE(MergeParts({one, older}).ok());
  EXPECT_TRUE(MergeParts({older, one}).ok());
  one.mutable_plan()->mutable_dataset_names()->RemoveLast();
  one.mutable_plan()->mutable_recordings(3)->set_dataset(1);
  other.mutable_plan()->mutable_recordings(3)->set_dataset(1);
  EXPECT_THAT(MergeError({one, other}, absl::StatusCode::kDataLoss),
              HasSubstr("recording 3 is of a dataset that has no name"));
}

TEST_F(CrossValidationReportTest, MetricsOfWholeSetsHaveTheRangeOverModels) {
  const v1::ModelRange& range = set().set_metrics().at("mutual_information");
  EXPECT_DOUBLE_EQ(range.smallest(), 1.1);
  EXPECT_DOUBLE_EQ(range.largest(), 2.3);
  const double first = MakeRun(1, 0).held_out().examples_size();
  const double second = MakeRun(1, 1).held_out().examples_size();
  EXPECT_NEAR(range.seed_values(0), (first * 1.1 + second * 2.1) / (first + second), 1e-12);
}

// The metric is a mean over groups of one size: then the jackknife gives the textbook's interval.
TEST(CrossValidationIntervalTest, AMetricOfWholeSetsHasAnInterval) {
  v1::CrossValidationPart part = Part({});
  double sum = 0.0;
  for (int i = 0; i < kRecordings; ++i) sum += NormalOf(i);
  double squares = 0.0;
  for (int i = 0; i < kRecordings; ++i) squares += std::pow(NormalOf(i) - sum / kRecordings, 2);
  for (const int64_t seed : {1, 3}) {
    part.mutable_plan()->add_seeds(seed);
    for (int fold = 0; fold < kFolds; ++fold) {
      v1::FoldRun& run = *part.add_runs();
      run.set_seed(seed);
      run.set_fold(fold);
      v1::MeasuredSet& set = *run.mutable_held_out();
      set = EmptySet();
      double of_fold = 0.0;
      constexpr int kOfFold = kRecordings / kFolds;
      for (int i = 0; i < kRecordings; ++i) {
        if (i % kFolds != fold) {
          run.add_learned(i);
          continue;
        }
        of_fold += NormalOf(i) + static_cast<double>(seed);
        AddExample(set, i, 1.0, 1.0, 1.0, 0);
      }
      (*set.mutable_set_metrics())["nmi"] = of_fold / kOfFold;
      (*set.mutable_set_metrics())["purity"] = 0.5;
      (*set.mutable_set_metrics())["effective_actions"] = 5.0;
      for (int i = fold; i < kRecordings; i += kFolds) {
        v1::SetWithoutBlock& without = *set.add_without();
        without.set_block(i);
        without.set_examples(kOfFold - 1);
        (*without.mutable_set_metrics())["effective_actions"] = 5.0;
        (*without.mutable_set_metrics())["nmi"] =
            (of_fold - NormalOf(i) - static_cast<double>(seed)) / (kOfFold - 1);
      }
    }
  }
  const auto whole = MergeParts({part});
  ASSERT_TRUE(whole.ok()) << whole.status();
  const v1::CrossValidationReport report = MakeCrossValidationReport(*whole, {.resamples = 100});
  const v1::ModelRange& range = report.sets(0).set_metrics().at("nmi");
  const double half = 1.96 * std::sqrt(squares / (kRecordings - 1) / kRecordings);
  EXPECT_NEAR(range.value(), 2.0 + sum / kRecordings, 1e-9);
  EXPECT_NEAR(range.lower(), range.value() - half, 1e-4 * half);
  EXPECT_NEAR(range.upper(), range.value() + half, 1e-4 * half);
  EXPECT_THAT(CrossValidationText(report, false),
              testing::ContainsRegex("nmi.* 2\\.[0-9]+ +1\\.[0-9]+ \\.\\. 2\\.[0-9]+ "));
  // Its value without a group is not known.
  EXPECT_FALSE(report.sets(0).set_metrics().at("purity").has_lower());
  // The error would be 0.
  EXPECT_FALSE(report.sets(0).set_metrics().at("effective_actions").has_lower());
}

// Of 1,000 examples each, the first fold has 10 with a manoeuvre and the second one 900.
TEST(CrossValidationIntervalTest, FoldsCountForRecordedManeuversByTheirLabelledExamples) {
  v1::CrossValidationPart part = Part({{1, 0}, {1, 1}});
  for (v1::FoldRun& run : *part.mutable_runs()) {
    const int fold = run.fold();
    v1::MeasuredSet& set = *run.mutable_held_out();
    set.clear_examples();
    for (int i = 0; i < 1000; ++i) {
      AddExample(set, kFolds * (i % (kRecordings / kFolds)) + fold, 1.0, 1.0, 1.0, 0);
    }
    const auto fill = [fold](double labelled, auto& metrics) {
      metrics["labelled_examples"] = labelled;
      for (const char* name : {"purity", "purity_relative"}) metrics[name] = fold == 0 ? 1.0 : 0.6;
    };
    const double labelled = fold == 0 ? 10.0 : 900.0;
    fill(labelled, *set.mutable_set_metrics());
    // Each fold has a block with a tenth of its examples and labels.
    v1::SetWithoutBlock& without = *set.add_without();
    without.set_block(fold);
    without.set_examples(900);
    fill(0.9 * labelled, *without.mutable_set_metrics());
  }
  const auto whole = MergeParts({part});
  ASSERT_TRUE(whole.ok()) << whole.status();
  const v1::CrossValidationReport report = MakeCrossValidationReport(*whole, {.resamples = 100});
  const v1::ModelRange& purity = report.sets(0).set_metrics().at("purity");
  EXPECT_NEAR(purity.value(), (10.0 + 0.6 * 900.0) / 910.0, 1e-12);
  const double without_first = (9.0 + 0.6 * 900.0) / 909.0;
  const double without_second = (10.0 + 0.6 * 810.0) / 820.0;
  // The jackknife's error of two values is half of their difference.
  EXPECT_NEAR(purity.upper() - purity.value(), 1.96 * 0.5 * (without_second - without_first), 1e-6);
  EXPECT_NEAR(report.sets(0).set_metrics().at("purity_relative").value(), 0.8, 1e-12);
}

TEST(CrossValidationSmallPartsTest, DoesNotComparePartsWithFewExamples) {
  v1::CrossValidationPart part = Part({{1, 0}, {1, 1}});
  for (v1::FoldRun& run : *part.mutable_runs()) {
    auto& examples = *run.mutable_held_out()->mutable_examples();
    examples.DeleteSubrange(24, examples.size() - 24);
  }
  const auto whole = MergeParts({part});
  ASSERT_TRUE(whole.ok()) << whole.status();
  const auto report = MakeCrossValidationReport(*whole, {.resamples = 100});
  EXPECT_EQ(report.sets(0).overall().examples(), 48);
  EXPECT_EQ(report.sets(0).overall().comparisons_size(), 0);
}

// Ten thousand groups; without a bound, the draws' memory would grow with them.
TEST(CrossValidationManyGroupsTest, DrawsGroupsTogetherAndKeepsTheInterval) {
  constexpr int kMany = 10'000;
  v1::CrossValidationPart part;
  part.mutable_plan()->set_folds(1);
  part.mutable_plan()->add_seeds(1);
  v1::FoldRun& run = *part.add_runs();
  run.set_seed(1);
  *run.mutable_held_out() = EmptySet();
  for (int i = 0; i < kMany; ++i) {
    part.mutable_plan()->add_recordings()->set_group(i);
    AddExample(*run.mutable_held_out(), i, 2.0 + 0.5 * NormalOf(i), 5.0, 5.0, 0);
  }
  const auto report = MakeCrossValidationReport(part, {.resamples = 400});
  EXPECT_EQ(report.sets(0).groups(), kMany);
  EXPECT_EQ(report.sets(0).overall().groups(), 4096);
  const v1::Estimate& ade = report.sets(0).overall().metrics().at("ade_1");
  const double half = 1.96 * 0.5 / std::sqrt(kMany);
  EXPECT_NEAR(ade.upper() - ade.value(), half, 0.2 * half);
  EXPECT_NEAR(ade.value() - ade.lower(), half, 0.2 * half);
}

// The models of all folds measure a test dataset; its recordings count once.
TEST(CrossValidationTestDatasetTest, AllModelsMeasureEveryExample) {
  v1::CrossValidationPart part = Part({{1, 0}, {1, 1}});
  v1::TestDataset& test = *part.mutable_plan()->add_test_datasets();
  test.set_name("other");
  test.set_left_out(3);
  for (int i = 0; i < 60; ++i) test.add_recordings()->set_group(1000 + i / 20);
  for (v1::FoldRun& run : *part.mutable_runs()) {
    v1::MeasuredSet& set = *run.add_tests();
    set = EmptySet();
    for (int i = 0; i < 60; ++i) AddExample(set, i, run.fold() == 0 ? 1.0 : 2.0, 1.0, 1.0, 0);
  }
  const auto whole = MergeParts({part});
  ASSERT_TRUE(whole.ok()) << whole.status();
  const auto report = MakeCrossValidationReport(*whole, {.resamples = 100});
  ASSERT_EQ(report.sets_size(), 2);
  const v1::CrossValidatedSet& other = report.sets(1);
  EXPECT_EQ(other.name(), "other");
  EXPECT_EQ(other.left_out(), 3);
  EXPECT_EQ(other.groups(), 3);
  EXPECT_EQ(other.largest_group(), 20);
  EXPECT_EQ(other.overall().examples(), 60);
  EXPECT_DOUBLE_EQ(other.overall().metrics().at("ade_1").value(), 1.5);
  const std::string text = CrossValidationText(report, false);
  EXPECT_THAT(text, HasSubstr("TEST DATASET other: 60 examples of 60 recordings in 3 groups"));
  EXPECT_THAT(text, HasSubstr("3 more recordings were left out"));
  EXPECT_THAT(text, HasSubstr("too narrow"));
}

TEST_F(CrossValidationReportTest, TheTextNamesTargetTypesIfThereAreSeveral) {
  v1::CrossValidationReport report = report_;
  for (const char* type : {"vehicle", "pedestrian"}) {
    EXPECT_EQ(CrossValidationText(report, false).find("BY TYPE"), std::string::npos);
    v1::CrossValidatedPart& part = *report.mutable_sets(0)->add_strata();
    part.set_dimension("type");
    part.set_name(type);
    part.set_examples(7);
  }
  const std::string text = CrossValidationText(report, false);
  EXPECT_THAT(text, HasSubstr("BY TYPE"));
  EXPECT_THAT(text, HasSubstr("\npedestrian "));
}

TEST_F(CrossValidationReportTest, TheTextSeparatesTheModelsMeaningFromTheBaselines) {
  v1::CrossValidationReport report = report_;
  auto& set_metrics = *report.mutable_sets(0)->mutable_set_metrics();
  for (const char* name : {"class_information_relative", "covernet_mutual_information"}) {
    set_metrics[name].set_value(0.5);
    set_metrics[name].set_smallest(0.25);
    set_metrics[name].set_largest(0.75);
  }
  const std::string text = CrossValidationText(report, false);
  const size_t meaning = text.find("\nMEANING, OF EACH MODEL");
  const size_t baselines = text.find("\nBASELINES, OF EACH MODEL");
  ASSERT_NE(meaning, text.npos);
  ASSERT_NE(baselines, text.npos);
  const std::string of_model = text.substr(meaning, baselines - meaning);
  EXPECT_THAT(of_model, HasSubstr("mutual_information, nats"));
  EXPECT_THAT(
      of_model,
      HasSubstr("class_information_relative, share  0.500              -   0.250 .. 0.750"));
  EXPECT_THAT(of_model, testing::Not(HasSubstr("covernet")));
  EXPECT_THAT(text.substr(baselines), HasSubstr("covernet_mutual_information, nats  0.500"));
}

TEST_F(CrossValidationReportTest, TheTextHasFiguresIntervalsAndVerdicts) {
  const std::string text = CrossValidationText(report_, false);
  EXPECT_THAT(text, HasSubstr("2 folds, training seeds 1, 3; 2000 draws"));
  EXPECT_THAT(text, HasSubstr("ade_1, m"));
  EXPECT_THAT(text, HasSubstr(" .. "));
  EXPECT_THAT(text, HasSubstr("mutual_information, nats"));
  EXPECT_THAT(text, HasSubstr("ahead -3.0"));
  EXPECT_THAT(text, HasSubstr("BY SPEED"));
  EXPECT_EQ(text.find("BY CLASS"), std::string::npos);
}

}  // namespace
}  // namespace maneuver::evaluation::cross_validation_test
