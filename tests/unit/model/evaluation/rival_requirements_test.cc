#include "model/evaluation/rival_requirements.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace maneuver::evaluation::rival_requirements_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

v1::RivalStanding& AddPart(v1::RivalStandings& standings, const std::string& dimension,
                           const std::string& name, int examples) {
  v1::RivalStanding& part = *standings.add_parts();
  part.set_dimension(dimension);
  part.set_name(name);
  part.set_examples(examples);
  part.set_groups(40);
  return part;
}

void AddComparison(v1::RivalStanding& part, const std::string& rival, double lower, double upper,
                   const std::string& metric = "ade_1") {
  v1::RivalComparison& comparison = *part.add_comparisons();
  comparison.set_metric(metric);
  comparison.set_rival(rival);
  comparison.mutable_difference()->set_value(0.5 * (lower + upper));
  comparison.mutable_difference()->set_lower(lower);
  comparison.mutable_difference()->set_upper(upper);
  comparison.set_verdict(upper < 0.0   ? v1::RIVAL_VERDICT_AHEAD
                         : lower > 0.0 ? v1::RIVAL_VERDICT_BEHIND
                                       : v1::RIVAL_VERDICT_UNDECIDED);
}

// Ahead of constant velocity overall and at 5-10 m/s, behind when stationary; turns have too few
// examples. Against CTRA the overall result is undecided.
v1::RivalStandings Standings() {
  v1::RivalStandings standings;
  v1::RivalStanding& all = AddPart(standings, "", "", 400);
  AddComparison(all, "cv", -0.75, -0.25);
  AddComparison(all, "ctra", -0.5, 0.25);
  v1::RivalStanding& slow = AddPart(standings, "speed", "5-10 m/s", 300);
  AddComparison(slow, "cv", -1.0, -0.5);
  AddComparison(slow, "ctra", -0.5, -0.25);
  v1::RivalStanding& stationary = AddPart(standings, "class", "stationary", 60);
  AddComparison(stationary, "cv", 0.125, 0.375);
  AddComparison(stationary, "ctra", -0.125, 0.125);
  AddPart(standings, "class", "u_turn", 40);
  return standings;
}

v1::RivalRequirement Require(const std::string& rival, v1::RivalStandard standard,
                             v1::RivalScope scope) {
  v1::RivalRequirement requirement;
  requirement.set_rival(rival);
  requirement.set_standard(standard);
  requirement.set_scope(scope);
  return requirement;
}

// Returns the names of the parts that fall short, "all" for all examples.
std::vector<std::string> Short(const v1::RivalRequirement& requirement,
                               const v1::RivalStandings& standings = Standings()) {
  RivalRequirements requirements;
  *requirements.Add() = requirement;
  std::vector<std::string> names;
  for (const v1::RivalShortfall& each : FindShortfalls(standings, requirements)) {
    names.push_back(each.name().empty() ? "all" : each.name());
  }
  return names;
}

TEST(RivalRequirementsTest, ARequirementOverAllExamplesIgnoresStrata) {
  const auto all = v1::RIVAL_SCOPE_ALL_EXAMPLES;
  EXPECT_THAT(Short(Require("cv", v1::RIVAL_STANDARD_AHEAD, all)), IsEmpty());
  EXPECT_THAT(Short(Require("ctra", v1::RIVAL_STANDARD_AHEAD, all)), ElementsAre("all"));
  EXPECT_THAT(Short(Require("ctra", v1::RIVAL_STANDARD_NOT_BEHIND, all)), IsEmpty());
}

TEST(RivalRequirementsTest, EveryStratumWithEnoughExamplesCounts) {
  const auto every = v1::RIVAL_SCOPE_EVERY_STRATUM;
  EXPECT_THAT(Short(Require("cv", v1::RIVAL_STANDARD_AHEAD, every)), ElementsAre("stationary"));
  EXPECT_THAT(Short(Require("cv", v1::RIVAL_STANDARD_NOT_BEHIND, every)),
              ElementsAre("stationary"));
  EXPECT_THAT(Short(Require("ctra", v1::RIVAL_STANDARD_AHEAD, every)),
              ElementsAre("all", "stationary"));
  EXPECT_THAT(Short(Require("ctra", v1::RIVAL_STANDARD_NOT_BEHIND, every)), IsEmpty());
}

TEST(RivalRequirementsTest, AnUnsetRequirementMeansAheadOverAllByAde) {
  v1::RivalRequirement requirement;
  requirement.set_rival("ctra");
  EXPECT_THAT(Short(requirement), ElementsAre("all"));
  requirement.set_rival("cv");
  EXPECT_THAT(Short(requirement), IsEmpty());
}

TEST(RivalRequirementsTest, AMissingComparisonIsOneShortfall) {
  const auto every = v1::RIVAL_SCOPE_EVERY_STRATUM;
  const auto not_behind = v1::RIVAL_STANDARD_NOT_BEHIND;
  EXPECT_THAT(Short(Require("covernet", not_behind, every)), ElementsAre("all"));
  EXPECT_THAT(Short(Require("cv", not_behind, every), {}), ElementsAre("all"));
  v1::RivalStandings few;
  AddPart(few, "", "", 49);
  EXPECT_THAT(Short(Require("cv", not_behind, every), few), ElementsAre("all"));
}

TEST(RivalRequirementsTest, TheTextNamesStrataAndFigures) {
  const auto every = v1::RIVAL_SCOPE_EVERY_STRATUM;
  RivalRequirements requirements;
  *requirements.Add() = Require("cv", v1::RIVAL_STANDARD_AHEAD, every);
  *requirements.Add() = Require("ctra", v1::RIVAL_STANDARD_AHEAD, every);
  EXPECT_EQ(ShortfallText(FindShortfalls(Standings(), requirements)),
            "not ahead of constant velocity by ade_1 in stationary (+0.250 m, 95 % +0.125 .. "
            "+0.375); not ahead of CTRA by ade_1 over all examples (-0.125 m, 95 % -0.500 .. "
            "+0.250), in stationary (+0.000 m, 95 % -0.125 .. +0.125)");

  requirements.Clear();
  *requirements.Add() = Require("cv", v1::RIVAL_STANDARD_NOT_BEHIND, every);
  *requirements.Add() = Require("covernet", v1::RIVAL_STANDARD_NOT_BEHIND, every);
  EXPECT_EQ(ShortfallText(FindShortfalls(Standings(), requirements)),
            "behind constant velocity by ade_1 in stationary (+0.250 m, 95 % +0.125 .. +0.375); "
            "not shown to be not behind CoverNet-like by ade_1 over all examples (the evaluation "
            "has no such rival)");
}

TEST(RivalRequirementsTest, TheTextSaysWhenGroupsAreTooFew) {
  v1::RivalStandings standings;
  v1::RivalStanding& all = AddPart(standings, "", "", 400);
  all.set_groups(1);
  AddComparison(all, "cv", -0.5, -0.25);
  all.mutable_comparisons(0)->set_verdict(v1::RIVAL_VERDICT_UNDECIDED);
  RivalRequirements requirements;
  requirements.Add()->set_rival("cv");
  EXPECT_THAT(ShortfallText(FindShortfalls(standings, requirements)),
              HasSubstr("; 1 group of recordings cannot decide)"));
}

TEST(RivalRequirementsTest, RefusesRivalsAndMetricsThatCannotBeCompared) {
  v1::RivalRequirement requirement;
  requirement.set_rival("nobody");
  EXPECT_EQ(CheckRequirement(requirement).field, "rival");
  requirement.set_rival("cv");
  EXPECT_EQ(CheckRequirement(requirement).field, "");
  requirement.set_metric("min_ade_6");  // constant velocity has one trajectory
  EXPECT_EQ(CheckRequirement(requirement).field, "metric");
  EXPECT_THAT(CheckRequirement(requirement).description,
              HasSubstr("ade_1, fde_1, miss_rate_1, ade_medoid"));
  requirement.set_rival("covernet");
  EXPECT_EQ(CheckRequirement(requirement).field, "");
  requirement.set_metric("ade_medoid");
  EXPECT_EQ(CheckRequirement(requirement).field, "metric");
  requirement.set_metric("purity");
  EXPECT_EQ(CheckRequirement(requirement).field, "metric");
  requirement.clear_metric();
  requirement.set_standard(static_cast<v1::RivalStandard>(7));
  EXPECT_EQ(CheckRequirement(requirement).field, "standard");
  requirement.clear_standard();
  requirement.set_scope(static_cast<v1::RivalScope>(7));
  EXPECT_EQ(CheckRequirement(requirement).field, "scope");
}

TEST(RivalRequirementsTest, RequirementsReadAsSentences) {
  EXPECT_EQ(RequirementText(
                Require("faded", v1::RIVAL_STANDARD_NOT_BEHIND, v1::RIVAL_SCOPE_EVERY_STRATUM)),
            "not behind the faded roll-out by ade_1 in every stratum");
}

}  // namespace
}  // namespace maneuver::evaluation::rival_requirements_test
