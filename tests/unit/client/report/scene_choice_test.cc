#include "client/report/scene_choice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

namespace maneuver::report::scene_choice_test {
namespace {

using testing::Contains;
using testing::ElementsAre;

v1::Trajectory Line(double end_x, double end_y) {
  v1::Trajectory line;
  for (const double share : {0.5, 1.0}) {
    line.add_x(share * end_x);
    line.add_y(share * end_y);
  }
  return line;
}

Scene MeasuredScene(const std::string& id, double ade_1, double min_ade_6, double surprise) {
  Scene scene;
  auto recording = std::make_shared<v1::Scenario>();
  recording->set_scenario_id(id);
  scene.recording = recording;
  scene.truth = Line(40.0, 0.0);
  scene.kinematic_class = "straight_fast";
  scene.ade_1 = ade_1;
  scene.min_ade_6 = min_ade_6;
  scene.surprise = surprise;
  return scene;
}

std::vector<std::string> Ids(const std::vector<Scene>& scenes, const std::string& group) {
  std::vector<std::string> ids;
  for (const Scene& scene : scenes) {
    if (std::ranges::find(scene.groups, group) != scene.groups.end()) {
      ids.push_back(scene.recording->scenario_id());
    }
  }
  return ids;
}

TEST(MeasureTest, ErrorsAreMeanDistancesAndSurpriseIsOfTheTrueAction) {
  Scene scene;
  scene.truth = Line(10.0, 0.0);
  *scene.prediction.add_distributions()->mutable_mean_trajectory() = Line(10.0, 4.0);
  *scene.prediction.add_distributions()->mutable_mean_trajectory() = Line(12.0, 0.0);
  for (const double p : {0.7, 0.25, 0.05}) scene.prediction.add_probabilities(p);
  scene.responsibilities = {0.1, 0.1, 0.8};
  Measure(&scene);
  EXPECT_DOUBLE_EQ(scene.ade_1, 3.0);      // 2 m, then 4 m to the left
  EXPECT_DOUBLE_EQ(scene.min_ade_6, 1.5);  // 1 m, then 2 m too far
  EXPECT_DOUBLE_EQ(scene.surprise, -std::log(0.05));
}

TEST(MeasureTest, CountsOnlyTheSixMostProbableActions) {
  Scene scene;
  scene.truth = Line(10.0, 0.0);
  for (int i = 0; i < 6; ++i) {
    *scene.prediction.add_distributions()->mutable_mean_trajectory() = Line(10.0, 4.0);
  }
  *scene.prediction.add_distributions()->mutable_mean_trajectory() = Line(10.0, 0.0);
  Measure(&scene);
  EXPECT_DOUBLE_EQ(scene.min_ade_6, 3.0);
}

TEST(ChooseScenesTest, TakesTheWorstTheBestAndTheMostSurprising) {
  std::vector<Scene> scenes;
  for (int i = 0; i < 50; ++i) scenes.push_back(MeasuredScene("dull", 2.0, 1.0, 1.0));
  scenes.push_back(MeasuredScene("worst", 9.0, 8.0, 1.0));
  scenes.push_back(MeasuredScene("best", 0.1, 0.1, 1.0));
  scenes.push_back(MeasuredScene("standing", 0.0, 0.0, 1.0));
  scenes.back().truth = Line(1.0, 0.0);
  scenes.push_back(MeasuredScene("surprising", 2.0, 1.0, 5.0));
  const std::vector<Scene> chosen = ChooseScenes(std::move(scenes), 5);
  EXPECT_EQ(chosen.size(), 5);
  EXPECT_THAT(Ids(chosen, "worst"), ElementsAre("worst"));
  EXPECT_THAT(Ids(chosen, "best"), ElementsAre("best"));  // "standing" goes less than 10 m
  EXPECT_THAT(Ids(chosen, "surprising"), ElementsAre("surprising"));
}

TEST(ChooseScenesTest, AppearsOnceWithAllOfItsGroups) {
  std::vector<Scene> scenes;
  for (int i = 0; i < 10; ++i) scenes.push_back(MeasuredScene("dull", 2.0, 1.0, 1.0));
  scenes.push_back(MeasuredScene("both", 9.0, 8.0, 9.0));
  const std::vector<Scene> chosen = ChooseScenes(std::move(scenes), 5);
  std::set<std::string> seen;
  for (const Scene& scene : chosen) {
    if (scene.recording->scenario_id() != "both") continue;
    EXPECT_TRUE(seen.insert("both").second);
    EXPECT_THAT(scene.groups, Contains("worst"));
    EXPECT_THAT(scene.groups, Contains("surprising"));
  }
  EXPECT_EQ(seen.size(), 1);
}

TEST(ChooseScenesTest, TakesAtMostTwoScenesOfARecordingPerGroup) {
  std::vector<Scene> scenes;
  for (int i = 0; i < 4; ++i) {
    scenes.push_back(MeasuredScene("bad", 9.0, 9.0, 1.0));
    scenes.back().recording = scenes.front().recording;
  }
  for (int i = 0; i < 20; ++i) scenes.push_back(MeasuredScene("other", 2.0, 2.0, 1.0));
  const std::vector<Scene> chosen = ChooseScenes(std::move(scenes), 20);  // four of each group
  EXPECT_THAT(Ids(chosen, "worst"), ElementsAre("bad", "bad", "other", "other"));
}

TEST(ChooseScenesTest, ShowsTheMedianSceneOfEveryClass) {
  std::vector<Scene> scenes;
  for (int i = 0; i < 21; ++i) {
    scenes.push_back(MeasuredScene("straight", 0.1 * i, 0.0, 0.0));
    scenes.push_back(MeasuredScene("turn", 1.0 + i, 0.0, 0.0));
    scenes.back().kinematic_class = "left_turn";
  }
  const std::vector<Scene> chosen = ChooseScenes(std::move(scenes), 12);
  std::map<std::string, double> first;
  for (const Scene& scene : chosen) {
    if (std::ranges::find(scene.groups, "typical") != scene.groups.end()) {
      first.try_emplace(scene.kinematic_class, scene.ade_1);
    }
  }
  EXPECT_NEAR(first["straight_fast"], 1.0, 1e-9);
  EXPECT_NEAR(first["left_turn"], 11.0, 1e-9);
}

TEST(ChooseScenesTest, ChoosesNothingFromNoScenes) { EXPECT_TRUE(ChooseScenes({}, 24).empty()); }

}  // namespace
}  // namespace maneuver::report::scene_choice_test
