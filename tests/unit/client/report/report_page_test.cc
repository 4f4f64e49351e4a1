#include "client/report/report_page.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <regex>
#include <string>

#include "absl/strings/escaping.h"
#include "client/report/report_json.h"
#include "model/files/digest.h"
#include "tests/unit/client/report/made_up_report.h"

namespace maneuver::report::report_page_test {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

// What lies between `begin` and the next `end`.
std::string Between(const std::string& text, const std::string& begin, const std::string& end) {
  const size_t start = text.find(begin);
  if (start == std::string::npos) return "";
  const size_t first = start + begin.size();
  return text.substr(first, text.find(end, first) - first);
}

std::string DataOf(const std::string& page) {
  return Between(page, R"(<script type="application/json" id="data">)", "</script>");
}

size_t Count(const std::string& text, const std::string& word) {
  size_t count = 0;
  for (size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++count;
  return count;
}

TEST(ReportPageTest, DataNeverEndsTheScript) {
  const std::string page = ReportPage(MadeUpReport());
  EXPECT_EQ(Count(page, "</script"), 2);  // that of the data and that of the program
  EXPECT_THAT(page, Not(HasSubstr("<img")));
  const json data = json::parse(DataOf(page));
  EXPECT_EQ(data["title"], "town/3");
  EXPECT_EQ(data["actions"]["list"][2]["name"], kHostile);
  EXPECT_EQ(data["scenes"][1]["id"], kHostile);
}

TEST(ReportPageTest, EscapesTheTitle) {
  ReportData data;
  data.title = "<b>\"{{PROGRAM}}\"</b>";
  const std::string page = ReportPage(data);
  EXPECT_THAT(page, HasSubstr("<title>&lt;b&gt;&quot;{{PROGRAM}}&quot;&lt;/b&gt; "));
}

TEST(ReportPageTest, AllowsOnlyItsOwnScriptAndStyleAndNoNetwork) {
  const std::string page = ReportPage(MadeUpReport());
  const std::string policy =
      Between(page, R"(http-equiv="Content-Security-Policy" content=")", "\"");
  const auto digest = [&](const std::string& begin, const std::string& end) {
    return absl::Base64Escape(absl::HexStringToBytes(files::Sha256Hex(Between(page, begin, end))));
  };
  EXPECT_THAT(policy, HasSubstr("default-src 'none'"));
  EXPECT_THAT(policy, HasSubstr("script-src 'sha256-" + digest("<script>", "</script>") + "'"));
  EXPECT_THAT(policy, HasSubstr("style-src 'sha256-" + digest("<style>", "</style>") + "'"));
  EXPECT_THAT(policy, Not(HasSubstr("unsafe")));
  // Nothing is loaded: the only address is the name of SVG's namespace.
  EXPECT_FALSE(std::regex_search(page, std::regex(R"((src|href)\s*=\s*["']?(https?:)?//)")));
  EXPECT_EQ(Count(page, "http://"), 1);
  EXPECT_EQ(Count(page, "https://"), 0);
}

TEST(ReportJsonTest, HasNoCharactersThatEndAScriptOrALine) {
  ReportData data;
  data.title =
      "a<b>&c\xe2\x80\xa8"
      "d";
  const std::string text = ReportJson(data);
  EXPECT_EQ(text.find_first_of("<>&"), std::string::npos);
  EXPECT_EQ(text.find("\xe2\x80\xa8"), std::string::npos);
  EXPECT_EQ(json::parse(text)["title"], data.title);
}

TEST(ReportJsonTest, KeepsTheRestWhereTextIsNotUtf8AndNumbersAreNotFinite) {
  ReportData data = MadeUpReport();
  data.title = "bad \xff name";
  (*data.evaluation->mutable_metrics())["nll"] = std::numeric_limits<double>::infinity();
  const json page = json::parse(ReportJson(data));
  EXPECT_EQ(page["title"], "bad \xef\xbf\xbd name");
  for (const json& metric : page["evaluation"]["metrics"]) {
    EXPECT_EQ(metric["value"].is_null(), metric["name"] == "nll") << metric;
  }
}

TEST(ReportJsonTest, NamesActionsByTheirDisplayNameThenLabelThenDerivedNameThenId) {
  ReportData data;
  v1::ActionSet& set = data.action_sets.emplace_back();
  set.add_actions()->set_display_name("shown");
  set.mutable_actions(0)->set_label("label");
  set.add_actions()->set_label("label");
  set.mutable_actions(1)->set_derived_name("derived");
  set.add_actions()->set_derived_name("derived");
  set.add_actions()->set_action_id(3);
  std::vector<std::string> names;
  const json page = json::parse(ReportJson(data));
  for (const json& action : page["actions"]["list"]) names.push_back(action["name"]);
  EXPECT_THAT(names, ElementsAre("shown", "label", "derived", "action 3"));
}

TEST(ReportJsonTest, ThinsOutWaypointsButKeepsTheLast) {
  ReportData data;
  v1::ActionSet& set = data.action_sets.emplace_back();
  v1::Trajectory& mean = *set.add_actions()->mutable_distribution()->mutable_mean_trajectory();
  for (int t = 1; t <= 80; ++t) {
    set.add_waypoint_times(0.1 * t);
    mean.add_x(t);
    mean.add_y(-t);
  }
  const json page = json::parse(ReportJson(data));
  const json& times = page["times"];
  EXPECT_LE(times.size(), 26);
  EXPECT_GE(times.size(), 13);
  EXPECT_DOUBLE_EQ(times.back(), 8.0);
  const json& points = page["actions"]["list"][0]["shapes"][0]["mean"];
  ASSERT_EQ(points.size(), 2 * times.size());
  for (size_t i = 0; i < times.size(); ++i) {
    EXPECT_NEAR(points[2 * i].get<double>(), 10.0 * times[i].get<double>(), 1e-9);
    EXPECT_EQ(points[2 * i + 1].get<double>(), -points[2 * i].get<double>());
  }
}

TEST(ReportJsonTest, LeavesOutTheLastScenesOfAPageThatWouldBeTooLong) {
  ReportData data = MadeUpReport();
  data.scenes.clear();
  const size_t without = ReportJson(data).size();
  for (int i = 0; i < 5; ++i) data.scenes.push_back(MadeUpScene(i, "best"));
  const size_t with_all = ReportJson(data).size();
  const size_t most = without + (with_all - without) / 2;
  const json page = json::parse(ReportJson(data, most));
  EXPECT_EQ(page["scenes"].size() + page["scenesLeftOut"].get<size_t>(), 5);
  EXPECT_GE(page["scenes"].size(), 1);
  EXPECT_GE(page["scenesLeftOut"], 2);
  EXPECT_EQ(page["scenes"][0]["id"], "recording 0");
}

TEST(ReportJsonTest, ALearningCurveHasNullsWhereAnEpochLacksATerm) {
  ReportData data;
  std::vector<v1::JobProgress> events = {MadeUpEpoch("joint", 1, 1), MadeUpEpoch("joint", 2, 2)};
  (*events[1].mutable_epoch_report()->mutable_training())["new_term"] = 5.0;
  data.learning = LearningPhases(events);
  const json learning = json::parse(ReportJson(data))["learning"];
  ASSERT_EQ(learning.size(), 1);
  for (const json& term : learning[0]["terms"]) {
    if (term["name"] == "new_term") {
      EXPECT_EQ(term["training"], json({nullptr, 5.0}));
    }
    if (term["name"] == "loss") {
      EXPECT_EQ(term["training"], json({4.0, 2.0}));
      EXPECT_EQ(term["heldOut"], json({4.5, 2.25}));
    }
    if (term["name"] == "effective_actions") {
      EXPECT_EQ(term["mixture"], json({4.0, 5.0}));
    }
  }
}

}  // namespace
}  // namespace maneuver::report::report_page_test
