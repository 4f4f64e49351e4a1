#include "model/evaluation/rival_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "absl/strings/str_split.h"
#include "model/evaluation/rival_table.h"
#include "model/evaluation/strata.h"

namespace maneuver::evaluation::rival_text_test {
namespace {

using testing::HasSubstr;
using testing::Not;

void AddComparison(v1::RivalStanding& part, const std::string& rival, double difference,
                   v1::RivalVerdict verdict, const std::string& metric = "ade_1") {
  v1::RivalComparison& comparison = *part.add_comparisons();
  comparison.set_metric(metric);
  comparison.set_rival(rival);
  comparison.mutable_difference()->set_value(difference);
  comparison.set_verdict(verdict);
}

v1::RivalStanding& AddPart(v1::RivalStandings& standings, const std::string& name, int examples) {
  v1::RivalStanding& part = *standings.add_parts();
  if (!name.empty()) part.set_dimension("class");
  part.set_name(name);
  part.set_examples(examples);
  return part;
}

TEST(RivalTextTest, ShowsOneTableAndALineForEachRival) {
  v1::RivalStandings standings;
  standings.set_recordings(35);
  standings.set_groups(30);
  v1::RivalStanding& all = AddPart(standings, "", 400);
  AddComparison(all, "cv", -0.5, v1::RIVAL_VERDICT_AHEAD);
  AddComparison(all, "ctra", -0.125, v1::RIVAL_VERDICT_UNDECIDED);
  v1::RivalStanding& left = AddPart(standings, "left_turn", 90);
  AddComparison(left, "cv", -1.25, v1::RIVAL_VERDICT_AHEAD);
  AddComparison(left, "ctra", -1.0, v1::RIVAL_VERDICT_AHEAD);
  v1::RivalStanding& stationary = AddPart(standings, "stationary", 60);
  AddComparison(stationary, "cv", 0.25, v1::RIVAL_VERDICT_BEHIND);
  AddComparison(stationary, "ctra", 0.0, v1::RIVAL_VERDICT_UNDECIDED);
  AddPart(standings, "u_turn", 3);
  EXPECT_EQ(RivalText(standings, false),
            "AHEAD BY ade_1, m?  EXAMPLES            CV         CTRA\n"
            "all                      400   ahead -0.50      ? -0.12\n"
            "left_turn                 90   ahead -1.25  ahead -1.00\n"
            "stationary                60  BEHIND +0.25      ? +0.00\n"
            "ade_1: ahead of constant velocity in 1 of 2 strata, behind in stationary\n"
            "ade_1: ahead of CTRA in 1 of 2 strata, undecided in stationary\n"
            "Mean differences. ahead, BEHIND: the whole 95 % interval is below, above 0; ?: it "
            "cannot tell. The\n"
            "    35 recordings are 30 groups that share no place and no drive.\n");
}

TEST(RivalTextTest, SaysWhenGroupsAreFew) {
  v1::RivalStandings standings;
  AddComparison(AddPart(standings, "", 400), "cv", -0.5, v1::RIVAL_VERDICT_UNDECIDED);
  standings.set_groups(9);
  EXPECT_THAT(RivalText(standings, false), HasSubstr("They are few"));
  standings.set_groups(5);
  EXPECT_THAT(RivalText(standings, false), HasSubstr("Fewer than 6 decide nothing."));
  standings.set_groups(10);
  EXPECT_THAT(RivalText(standings, false), Not(HasSubstr("They are few")));
}

TEST(RivalTextTest, IsEmptyIfNothingWasCompared) {
  v1::RivalStandings standings;
  AddPart(standings, "", 12);
  EXPECT_EQ(RivalText(standings, false), "");
  EXPECT_EQ(RivalText({}, false), "");
}

TEST(RivalTextTest, FitsAHundredColumnsWithEveryRivalAndStratum) {
  v1::RivalStandings standings;
  standings.set_recordings(123456);
  standings.set_groups(123456);
  const auto add = [&](const std::string& name) {
    v1::RivalStanding& part = AddPart(standings, name, 1234567);
    for (const Rival& rival : kRivals) {
      for (const char* metric : {"ade_1", "min_ade_6"}) {
        AddComparison(part, std::string(rival.name), 9.99, v1::RIVAL_VERDICT_BEHIND, metric);
      }
    }
  };
  add("");
  for (const Stratification& each : Stratifications()) {
    if (each.dimension != "speed" && each.dimension != "class") continue;
    for (const std::string_view name : each.names) add(std::string(name));
  }
  const std::string text = RivalText(standings, false);
  for (const absl::string_view line : absl::StrSplit(text, '\n')) {
    EXPECT_LE(line.size(), 100u) << line;
  }
  EXPECT_THAT(text, HasSubstr("min_ade_6: ahead of CoverNet-like in 0 of 14 strata, behind in"));
  EXPECT_THAT(text, HasSubstr("lane_change_right"));
}

}  // namespace
}  // namespace maneuver::evaluation::rival_text_test
