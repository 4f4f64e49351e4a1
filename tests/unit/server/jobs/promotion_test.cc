#include "server/jobs/promotion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <utility>
#include <vector>

#include "server/jobs/job_requests.h"

namespace maneuver::jobs::promotion_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr char kOld[] = "models/town/versions/1";
constexpr char kNew[] = "models/town/versions/2";
constexpr char kOther[] = "models/town/versions/3";

// Versions of which everything is known.
class FakeVersions final : public PromotionVersions {
 public:
  std::string Serving() override { return serving; }
  absl::StatusOr<v1::EvaluationReport> FindReport(const std::string& version) override {
    const auto found = kept.find(version);
    if (found == kept.end()) return absl::NotFoundError("it was not evaluated");
    return found->second;
  }
  MeasuredVersion Measure(const std::string& version) override {
    measured.push_back(version);
    if (on_measure) on_measure(version);
    if (!failure.ok()) return {failure, interrupted, {}};
    kept[version] = truth.at(version);
    return {absl::OkStatus(), false, truth.at(version)};
  }
  absl::StatusOr<bool> Promote(const std::string& version, const std::string& before) override {
    EXPECT_TRUE(remembered && remembered->promoted()) << "not written down first";
    if (!promotion_failure.ok()) return promotion_failure;
    if (serving != before) return false;
    serving = version;
    return true;
  }
  absl::Status Remember(const v1::PromotionDecision& decision) override {
    remembered = decision;
    return absl::OkStatus();
  }
  std::optional<v1::PromotionDecision> Remembered() override { return remembered; }

  std::string serving = kOld;
  std::map<std::string, v1::EvaluationReport> kept;
  std::map<std::string, v1::EvaluationReport> truth;
  std::vector<std::string> measured;
  std::function<void(const std::string&)> on_measure;
  absl::Status failure;
  bool interrupted = false;
  absl::Status promotion_failure;
  std::optional<v1::PromotionDecision> remembered;
};

class PromotionTest : public testing::Test {
 protected:
  PromotionTest() {
    v1::PromotionCriteria criteria;
    criteria.set_dataset("datasets/unseen");
    task_ = {"models/town", kNew, ResolveCriteria(criteria), "abc"};
    versions_.truth[kOld] = Report(kOld, 1.0, 2.0);
    versions_.truth[kNew] = Report(kNew, 0.5, 1.5);
    versions_.truth[kOther] = Report(kOther, 0.25, 1.0);
  }

  v1::EvaluationReport Report(const std::string& version, double min_ade, double nll) const {
    v1::EvaluationReport report;
    report.set_model_version(version);
    report.set_dataset("datasets/unseen");
    report.set_dataset_sha256("abc");
    report.set_examples(10);
    *report.mutable_example_settings() = task_.criteria.examples();
    (*report.mutable_metrics())["min_ade_6"] = min_ade;
    (*report.mutable_metrics())["nll"] = nll;
    (*report.mutable_metrics())["fde_1"] = 7.0;
    return report;
  }
  v1::PromotionDecision Decide() {
    const PromotionOutcome outcome = DecidePromotion(task_, versions_);
    EXPECT_TRUE(outcome.decision) << outcome.interruption;
    return outcome.decision.value_or(v1::PromotionDecision());
  }

  PromotionTask task_;
  FakeVersions versions_;
};

TEST_F(PromotionTest, ByDefaultMinAde6AndNllMustBeNoWorse) {
  std::vector<std::string> metrics;
  for (const auto& metric : task_.criteria.metrics()) metrics.push_back(metric.metric());
  EXPECT_THAT(metrics, ElementsAre("min_ade_6", "nll"));
}

TEST_F(PromotionTest, ABetterVersionIsPromotedWithTheFiguresOfBoth) {
  const v1::PromotionDecision decision = Decide();
  EXPECT_TRUE(decision.promoted()) << decision.reason();
  EXPECT_EQ(versions_.serving, kNew);
  EXPECT_THAT(versions_.measured, ElementsAre(kNew, kOld));
  const v1::EvaluationComparison& figures = decision.comparison();
  EXPECT_EQ(figures.baseline(), kOld);
  EXPECT_EQ(figures.candidate(), kNew);
  EXPECT_EQ(figures.dataset(), "datasets/unseen");
  EXPECT_EQ(figures.examples(), 10);
  ASSERT_EQ(figures.metrics_size(), 2);
  EXPECT_EQ(figures.metrics(0).metric(), "min_ade_6");
  EXPECT_EQ(figures.metrics(0).baseline_value(), 1.0);
  EXPECT_EQ(figures.metrics(0).candidate_value(), 0.5);
  EXPECT_EQ(figures.metrics(1).candidate_value(), 1.5);
}

TEST_F(PromotionTest, AnEqualVersionIsPromoted) {
  versions_.truth[kNew] = Report(kNew, 1.0, 2.0);
  EXPECT_TRUE(Decide().promoted());
}

TEST_F(PromotionTest, OneWorseMetricKeepsTheServingVersion) {
  versions_.truth[kNew] = Report(kNew, 0.5, 2.125);
  const v1::PromotionDecision decision = Decide();
  EXPECT_FALSE(decision.promoted());
  EXPECT_EQ(versions_.serving, kOld);
  EXPECT_EQ(decision.reason(),
            "worse than models/town/versions/1 on datasets/unseen: nll 2.1250 against 2.0000 nats");
  EXPECT_EQ(decision.comparison().metrics(0).verdict(), v1::METRIC_VERDICT_BETTER);
  EXPECT_EQ(decision.comparison().metrics(1).verdict(), v1::METRIC_VERDICT_WORSE);
  EXPECT_FALSE(decision.has_error());

  task_.criteria.mutable_metrics(1)->set_tolerance(0.125);
  EXPECT_TRUE(Decide().promoted());
}

TEST_F(PromotionTest, OnlyTheNamedMetricsDecide) {
  versions_.truth[kNew] = Report(kNew, 9.0, 9.0);
  task_.criteria.clear_metrics();
  task_.criteria.add_metrics()->set_metric("fde_1");
  EXPECT_TRUE(Decide().promoted());
}

TEST_F(PromotionTest, PromotesTheFirstVersionWithoutMeasuring) {
  versions_.serving = "";
  const v1::PromotionDecision decision = Decide();
  EXPECT_TRUE(decision.promoted());
  EXPECT_EQ(decision.reason(), "no version of models/town served");
  EXPECT_THAT(versions_.measured, IsEmpty());
  EXPECT_EQ(versions_.serving, kNew);
}

// Constant velocity over all examples: ahead of it by 0.5 m, unless told otherwise.
void StandBesideConstantVelocity(v1::EvaluationReport& report,
                                 v1::RivalVerdict verdict = v1::RIVAL_VERDICT_AHEAD) {
  v1::RivalStanding& all = *report.mutable_rivals()->add_parts();
  all.set_examples(400);
  all.set_groups(40);
  v1::RivalComparison& comparison = *all.add_comparisons();
  comparison.set_metric("ade_1");
  comparison.set_rival("cv");
  comparison.mutable_difference()->set_value(-0.5);
  comparison.mutable_difference()->set_lower(-0.75);
  comparison.mutable_difference()->set_upper(0.25);
  comparison.set_verdict(verdict);
}

TEST_F(PromotionTest, RefusesAVersionThatMissesARequirementAndGivesTheFigures) {
  task_.criteria.add_rivals()->set_rival("cv");
  StandBesideConstantVelocity(versions_.truth[kNew], v1::RIVAL_VERDICT_UNDECIDED);
  const v1::PromotionDecision decision = Decide();
  EXPECT_FALSE(decision.promoted());
  EXPECT_EQ(versions_.serving, kOld);
  EXPECT_EQ(decision.reason(),
            "what is required on datasets/unseen is not met: not ahead of constant velocity by "
            "ade_1 over all examples (-0.500 m, 95 % -0.750 .. +0.250)");
  ASSERT_EQ(decision.shortfalls_size(), 1);
  EXPECT_EQ(decision.shortfalls(0).requirement().rival(), "cv");
  EXPECT_EQ(decision.shortfalls(0).comparison().difference().upper(), 0.25);
  // Both versions' figures are there all the same.
  EXPECT_EQ(decision.comparison().metrics_size(), 2);
  EXPECT_FALSE(decision.has_error());
}

TEST_F(PromotionTest, GivesBothReasonsForAWorseVersionThatMissesARequirement) {
  task_.criteria.add_rivals()->set_rival("cv");
  versions_.truth[kNew] = Report(kNew, 0.5, 2.125);
  StandBesideConstantVelocity(versions_.truth[kNew], v1::RIVAL_VERDICT_UNDECIDED);
  const v1::PromotionDecision decision = Decide();
  EXPECT_THAT(decision.reason(), HasSubstr("nll 2.1250 against 2.0000 nats; what is required"));
}

TEST_F(PromotionTest, AVersionThatMeetsItsRequirementsMustAlsoBeNoWorse) {
  task_.criteria.add_rivals()->set_rival("cv");
  StandBesideConstantVelocity(versions_.truth[kNew]);
  v1::PromotionDecision decision = Decide();
  EXPECT_TRUE(decision.promoted()) << decision.reason();
  EXPECT_THAT(decision.reason(),
              HasSubstr("; ahead of constant velocity by ade_1 over all examples"));

  versions_.serving = kOld;
  versions_.remembered.reset();
  versions_.kept.clear();
  versions_.truth[kNew] = Report(kNew, 0.5, 2.125);
  StandBesideConstantVelocity(versions_.truth[kNew]);
  decision = Decide();
  EXPECT_FALSE(decision.promoted());
  EXPECT_EQ(decision.shortfalls_size(), 0);
}

TEST_F(PromotionTest, MeasuresTheFirstVersionIfThereAreRequirements) {
  task_.criteria.add_rivals()->set_rival("cv");
  versions_.serving = "";
  StandBesideConstantVelocity(versions_.truth[kNew], v1::RIVAL_VERDICT_BEHIND);
  v1::PromotionDecision decision = Decide();
  EXPECT_FALSE(decision.promoted());
  EXPECT_THAT(versions_.measured, ElementsAre(kNew));
  EXPECT_EQ(versions_.serving, "");

  versions_.kept[kNew] = Report(kNew, 0.5, 1.5);
  StandBesideConstantVelocity(versions_.kept[kNew]);
  decision = Decide();
  EXPECT_TRUE(decision.promoted()) << decision.reason();
  EXPECT_THAT(decision.reason(), HasSubstr("no version of models/town served; ahead of"));
  EXPECT_EQ(versions_.serving, kNew);
}

// As an earlier release kept it.
TEST_F(PromotionTest, RepeatsAReportWithoutRivalsIfThereAreRequirements) {
  versions_.kept[kNew] = versions_.truth[kNew];
  versions_.kept[kOld] = versions_.truth[kOld];
  task_.criteria.add_rivals()->set_rival("cv");
  StandBesideConstantVelocity(versions_.truth[kNew]);
  EXPECT_TRUE(Decide().promoted());
  EXPECT_THAT(versions_.measured, ElementsAre(kNew));
}

TEST_F(PromotionTest, RefusesRequirementsThatCannotBeMet) {
  v1::TrainRequest request;
  request.set_model("models/town");
  request.add_datasets("datasets/town");
  request.set_promotion(v1::PROMOTION_IF_NO_WORSE);
  request.mutable_promotion_criteria()->set_dataset("datasets/unseen");
  v1::RivalRequirement& requirement = *request.mutable_promotion_criteria()->add_rivals();
  requirement.set_rival("cv");
  EXPECT_TRUE(CheckTrainRequest(request).ok());
  requirement.set_metric("nll");
  EXPECT_THAT(std::string(CheckTrainRequest(request).message()),
              HasSubstr("promotion_criteria.rivals[0].metric"));
  requirement.set_rival("covernet");
  EXPECT_THAT(std::string(CheckTrainRequest(request).message()), HasSubstr("settings.baselines"));
  request.mutable_settings()->set_baselines(true);
  EXPECT_TRUE(CheckTrainRequest(request).ok());
}

// The wrong fields that an error lists.
google::protobuf::RepeatedPtrField<v1::BadRequest::FieldViolation> Listed(
    const absl::Status& status) {
  v1::BadRequest details;
  const auto payload = status.GetPayload("type.googleapis.com/google.rpc.BadRequest");
  EXPECT_TRUE(payload && details.ParseFromString(std::string(*payload))) << status;
  return details.field_violations();
}

TEST_F(PromotionTest, RefusesTooManyRequirementsWithoutLookingAtThem) {
  v1::TrainRequest request;
  request.set_model("models/town");
  request.add_datasets("datasets/town");
  request.set_promotion(v1::PROMOTION_IF_NO_WORSE);
  request.mutable_promotion_criteria()->set_dataset("datasets/unseen");
  // Each is wrong without settings.baselines.
  for (int i = 0; i < 100'000; ++i) {
    request.mutable_promotion_criteria()->add_rivals()->set_rival("covernet");
  }
  const absl::Status refused = CheckTrainRequest(request);
  EXPECT_EQ(std::string(refused.message()), "promotion_criteria.rivals: must be at most 20");
  EXPECT_EQ(Listed(refused).size(), 1);
}

TEST_F(PromotionTest, ListsTheFirst16WrongFieldsAndCountsTheOthers) {
  v1::TrainRequest request;
  request.set_model("models/town");
  for (int i = 0; i < 100; ++i) request.add_datasets("no dataset");
  const auto listed = Listed(CheckTrainRequest(request));
  ASSERT_EQ(listed.size(), 16);
  EXPECT_EQ(listed[0].field(), "datasets[0]");
  EXPECT_EQ(listed[15].field(), "datasets[15]");
  EXPECT_THAT(listed[15].description(), HasSubstr(" (and 84 more fields are wrong)"));
}

// What is wrong is found in the settings, which are a part of each request.
TEST_F(PromotionTest, CountsTheWrongFieldsOfAPartOfARequest) {
  v1::ExampleSettings examples;
  examples.mutable_dataset_weights()->Resize(1000, -1.0);
  v1::TrainRequest train;
  train.set_model("models/town");
  for (int i = 0; i < 20; ++i) train.add_datasets(absl::StrCat("datasets/town-", i));
  *train.mutable_settings()->mutable_examples() = examples;
  v1::EvaluateRequest evaluate;
  evaluate.set_model("models/town");
  evaluate.set_dataset("datasets/town");
  *evaluate.mutable_examples() = examples;
  // Of Train's, one more: there are not as many weights as datasets.
  for (const auto& [refused, count] : {std::pair(CheckTrainRequest(train), 1001),
                                       std::pair(CheckEvaluateRequest(evaluate), 1001)}) {
    const auto listed = Listed(refused);
    ASSERT_EQ(listed.size(), 16) << refused;
    EXPECT_THAT(listed[15].description(),
                HasSubstr(absl::StrCat(" (and ", count - 16, " more fields are wrong)")));
    EXPECT_THAT(std::string(refused.message()),
                HasSubstr(absl::StrCat(" (and ", count - 1, " more)")));
  }
}

TEST_F(PromotionTest, ReusesAReportOnlyOfTheSameExamples) {
  versions_.kept[kOld] = versions_.truth[kOld];
  Decide();
  EXPECT_THAT(versions_.measured, ElementsAre(kNew));

  versions_.serving = kOld;
  versions_.remembered.reset();
  versions_.measured.clear();
  versions_.kept[kOld].mutable_example_settings()->mutable_stride()->set_seconds(77);
  versions_.kept[kNew].set_dataset_sha256("of the dataset that had the name before");
  Decide();
  EXPECT_THAT(versions_.measured, ElementsAre(kNew, kOld));
}

TEST_F(PromotionTest, MeasuresEverythingBeforeItDecides) {
  versions_.kept[kOld] = versions_.truth[kOld];
  EXPECT_THAT(VersionsToMeasure(task_, versions_), ElementsAre(kNew));
  const PromotionOutcome measured = MeasureVersions(task_, versions_);
  EXPECT_FALSE(measured.decision);
  EXPECT_TRUE(measured.interruption.ok()) << measured.interruption;
  EXPECT_THAT(VersionsToMeasure(task_, versions_), IsEmpty());
  EXPECT_TRUE(Decide().promoted());
  EXPECT_THAT(versions_.measured, ElementsAre(kNew));
}

TEST_F(PromotionTest, MeasuresNothingForAStoredDecision) {
  Decide();
  versions_.serving = kOld;  // the server died before it promoted
  versions_.kept.clear();
  EXPECT_THAT(VersionsToMeasure(task_, versions_), IsEmpty());
}

TEST_F(PromotionTest, DecidesAgainstAVersionThatCannotBeMeasured) {
  versions_.failure = absl::FailedPreconditionError("the recordings hold no example");
  const PromotionOutcome outcome = MeasureVersions(task_, versions_);
  ASSERT_TRUE(outcome.decision);
  EXPECT_FALSE(outcome.decision->promoted());
  EXPECT_THAT(outcome.decision->reason(), HasSubstr("the recordings hold no example"));
  EXPECT_THAT(versions_.measured, ElementsAre(kNew));
}

TEST_F(PromotionTest, DoesNotCompareVersionsOfDifferentHorizons) {
  versions_.truth[kNew].mutable_trajectory()->set_waypoints(20);
  const v1::PromotionDecision decision = Decide();
  EXPECT_FALSE(decision.promoted());
  EXPECT_THAT(decision.reason(), HasSubstr("20 waypoints"));
  EXPECT_TRUE(decision.has_error());
}

TEST_F(PromotionTest, AFailedMeasurementDecidesAgainstPromotion) {
  versions_.failure = absl::FailedPreconditionError("the recordings hold no example");
  const v1::PromotionDecision decision = Decide();
  EXPECT_FALSE(decision.promoted());
  EXPECT_THAT(decision.reason(), HasSubstr("the recordings hold no example"));
  EXPECT_EQ(decision.error().code(), static_cast<int>(absl::StatusCode::kFailedPrecondition));
  EXPECT_EQ(versions_.serving, kOld);
}

TEST_F(PromotionTest, AnInterruptionDecidesNothingAndKeepsFinishedReports) {
  versions_.on_measure = [this](const std::string& version) {
    if (version == kOld) {
      versions_.failure = absl::UnavailableError("the server stops");
      versions_.interrupted = true;
    }
  };
  const PromotionOutcome outcome = DecidePromotion(task_, versions_);
  EXPECT_FALSE(outcome.decision);
  EXPECT_TRUE(absl::IsUnavailable(outcome.interruption));

  versions_.on_measure = nullptr;
  versions_.failure = absl::OkStatus();
  versions_.measured.clear();
  EXPECT_TRUE(Decide().promoted());
  EXPECT_THAT(versions_.measured, ElementsAre(kOld));
}

TEST_F(PromotionTest, KeepsTheFiguresIfTheServerDiesAfterPromoting) {
  const v1::PromotionDecision first = Decide();
  versions_.measured.clear();
  const v1::PromotionDecision again = Decide();  // as a new server would
  EXPECT_EQ(again.SerializeAsString(), first.SerializeAsString());
  EXPECT_THAT(versions_.measured, IsEmpty());
}

TEST_F(PromotionTest, AppliesAStoredDecisionIfTheServerDiedBeforePromoting) {
  const v1::PromotionDecision first = Decide();
  versions_.serving = kOld;
  versions_.measured.clear();
  const v1::PromotionDecision again = Decide();
  EXPECT_EQ(again.SerializeAsString(), first.SerializeAsString());
  EXPECT_EQ(versions_.serving, kNew);
}

TEST_F(PromotionTest, ComparesWithAVersionThatCameToServeMeanwhile) {
  versions_.on_measure = [this](const std::string& version) {
    if (version == kOld) versions_.serving = kOther;  // better than the new one
  };
  const v1::PromotionDecision decision = Decide();
  EXPECT_FALSE(decision.promoted());
  EXPECT_EQ(decision.comparison().baseline(), kOther);
  EXPECT_EQ(versions_.serving, kOther);
  EXPECT_THAT(versions_.measured, ElementsAre(kNew, kOld, kOther));
}

TEST_F(PromotionTest, DecidesAgainIfAnotherVersionServesNow) {
  Decide();
  versions_.serving = kOther;
  EXPECT_FALSE(Decide().promoted());
  EXPECT_EQ(versions_.serving, kOther);
}

TEST_F(PromotionTest, AcceptsAManualPromotionMadeMeanwhile) {
  versions_.serving = kNew;
  const v1::PromotionDecision decision = Decide();
  EXPECT_TRUE(decision.promoted());
  EXPECT_THAT(decision.reason(), HasSubstr("already"));
  EXPECT_THAT(versions_.measured, IsEmpty());
}

TEST_F(PromotionTest, DoesNotPromoteAVersionThatCannotBeLoaded) {
  versions_.promotion_failure = absl::FailedPreconditionError("it cannot be served");
  const v1::PromotionDecision decision = Decide();
  EXPECT_FALSE(decision.promoted());
  EXPECT_THAT(decision.reason(), HasSubstr("it cannot be served"));
}

}  // namespace
}  // namespace maneuver::jobs::promotion_test
