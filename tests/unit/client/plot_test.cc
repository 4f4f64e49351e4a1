#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "client/plot/action_gallery_plot.h"
#include "client/plot/action_set_plot.h"
#include "client/plot/axes.h"
#include "client/plot/canvas.h"
#include "client/plot/label_placer.h"
#include "client/plot/picture_size.h"
#include "client/plot/recordings_plot.h"
#include "client/plot/scene_plot.h"
#include "client/plot/share_plot.h"
#include "model/scene/pose2.h"
#include "tests/unit/client/pictures_for_tests.h"

namespace maneuver::plot::plot_test {
namespace {

// Returns how far a pixel near a world point is from a colour, in one panel 140 m wide.
int NearestInRecording(const cv::Mat& picture, double x, double y, Color color) {
  const cv::Point2d middle(42.0 + (800.0 - 42.0 - 16.0) / 2.0, 44.0 + (760.0 - 44.0 - 42.0) / 2.0);
  const double scale = (800.0 - 42.0 - 16.0) / 140.0;
  int nearest = 255;
  for (int dy = -2; dy <= 2; ++dy) {
    for (int dx = -2; dx <= 2; ++dx) {
      const cv::Point pixel(static_cast<int>(std::lround(middle.x + scale * (x - 100.0))) + dx,
                            static_cast<int>(std::lround(middle.y - scale * (y - 50.0))) + dy);
      nearest = std::min(nearest, Distance(picture.at<cv::Vec3b>(pixel), color));
    }
  }
  return nearest;
}

// Returns how many pixels have a colour.
int CountColor(const cv::Mat& picture, Color color) {
  int count = 0;
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      count += Distance(picture.at<cv::Vec3b>(y, x), color) < 12 ? 1 : 0;
    }
  }
  return count;
}

TEST(SharePlotTest, DrawsEachShareWithItsIntervalAndMarksChanges) {
  constexpr Color kFirst = {0, 114, 178};
  constexpr Color kSecond = {213, 94, 0};
  constexpr Color kChanged = {255, 240, 200};
  SharePlot shares{.title = "Shares by action",
                   .subtitle = "june",
                   .name = "june",
                   .against = "",
                   .rows = {"left turn", "stop"},
                   .panels = {}};
  shares.panels.push_back(
      {"all", "10 windows", {{{0.2, 0.1, 0.3}, {}, false}, {{0.8, 0.7, 0.9}, {}, false}}});
  const auto alone = DrawShares(shares);
  ASSERT_TRUE(alone.ok()) << alone.status();
  const int narrow = CountColor(Decode(*alone), kFirst);
  EXPECT_GT(narrow, 100);
  EXPECT_EQ(CountColor(Decode(*alone), kSecond), 0);
  EXPECT_EQ(CountColor(Decode(*alone), kChanged), 0);
  // A wider interval is a longer line. The scale stays, since the largest end does.
  shares.panels[0].cells[0].share.high = 0.6;
  EXPECT_GT(CountColor(Decode(*DrawShares(shares)), kFirst), narrow + 100);
  shares.against = "may";
  for (ShareCell& cell : shares.panels[0].cells) cell.against = PlottedShare{0.5, 0.4, 0.6};
  shares.panels[0].cells[1].changed = true;
  const cv::Mat compared = Decode(*DrawShares(shares));
  EXPECT_GT(CountColor(compared, kSecond), 100);
  EXPECT_GT(CountColor(compared, kChanged), 5'000);
}

TEST(SharePlotTest, TextStaysWithinThePicture) {
  SharePlot shares{.title = "Shares by class",
                   .subtitle =
                       "/srv/fleet/tags/2026-06-town against /srv/fleet/tags/2026-05-town; "
                       "coloured: the interval of the change leaves out 0",
                   .name = "/srv/fleet/tags/2026-06-town",
                   .against = "/srv/fleet/tags/2026-05-town",
                   .rows = {"car"},
                   .panels = {}};
  shares.panels.push_back({"all", "10 windows", {{{0.2, 0.1, 0.3}, {{0.2, 0.1, 0.3}}, false}}});
  for (const std::string& longer : {std::string(), std::string(1'000, 'x')}) {
    shares.subtitle += longer;
    shares.against += longer;
    const cv::Mat picture = Decode(*DrawShares(shares));
    EXPECT_LE(picture.cols, 2'400);
    const cv::Mat margin = picture.colRange(picture.cols - 14, picture.cols);
    EXPECT_EQ(CountColor(margin, kWhite), margin.rows * margin.cols);
  }
}

TEST(SharePlotTest, RefusesWhatCannotBeDrawn) {
  SharePlot shares;
  EXPECT_TRUE(absl::IsInvalidArgument(DrawShares(shares).status()));
  shares.rows = {"a"};
  shares.panels.resize(1);
  EXPECT_TRUE(absl::IsInvalidArgument(DrawShares(shares).status())) << "a panel without cells";
  shares.rows.resize(1'000);
  shares.panels[0].cells.resize(1'000);
  EXPECT_TRUE(absl::IsInvalidArgument(DrawShares(shares).status()));
}

TEST(RecordingsPlotTest, DrawsTargetsAndTheirPathsNorthUp) {
  v1::Scenario recording = Scene();
  recording.mutable_agents(0)->set_type(v1::AGENT_TYPE_VEHICLE);
  const auto png = DrawRecordings({&recording, 1}, {.width = 800, .height = 800});
  ASSERT_TRUE(png.ok()) << png.status();
  const cv::Mat picture = Decode(*png);
  ASSERT_EQ(picture.cols, 800);
  constexpr Color kYellow = {255, 214, 10};
  constexpr Color kPath = {240, 240, 244};
  EXPECT_LT(NearestInRecording(picture, 100.0, 50.0, kYellow), 60);
  const v1::AgentState& later = recording.agents(0).states(6);
  EXPECT_LT(NearestInRecording(picture, later.x(), later.y(), kPath), 40);
  // Its mirror image, which an upside-down picture would show.
  EXPECT_GT(NearestInRecording(picture, later.x(), 100.0 - later.y(), kPath), 100);
}

TEST(RecordingsPlotTest, DrawsTheMiddleTimeIfNobodyIsVisibleAtThePredictionTime) {
  v1::Scenario recording = Scene();
  recording.set_prediction_time(100.0);
  EXPECT_TRUE(DrawRecordings({&recording, 1}, {}).ok());
  recording.clear_agents();
  EXPECT_TRUE(absl::IsInvalidArgument(DrawRecordings({&recording, 1}, {}).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(DrawRecordings({}, {}).status()));
}

TEST(ScenePlotTest, IsAPngOfTheRequestedSize) {
  const auto png = DrawScene(Scene(), Answer(0.9), Options());
  ASSERT_TRUE(png.ok()) << png.status();
  EXPECT_EQ(png->substr(0, 8), "\x89PNG\r\n\x1a\n");
  const cv::Mat picture = Decode(*png);
  EXPECT_EQ(picture.cols, 900);
  EXPECT_EQ(picture.rows, 600);
}

TEST(ScenePlotTest, TheSameInputGivesTheSameBytes) {
  EXPECT_EQ(*DrawScene(Scene(), Answer(0.9), Options()),
            *DrawScene(Scene(), Answer(0.9), Options()));
}

TEST(ScenePlotTest, DrawsTheTruthWhiteAndTheActionInItsColour) {
  const cv::Mat picture = Decode(*DrawScene(Scene(), Answer(0.9), Options()));
  const PictureFrame frame(picture);
  for (const double ahead : {15.0, 25.0, 35.0}) {
    EXPECT_LT(frame.NearestDistance(picture, ahead, 0.2 * ahead, kWhite), 12) << ahead;
    EXPECT_LT(frame.NearestDistance(picture, ahead, -0.2 * ahead, ActionColor(2)), 12) << ahead;
    EXPECT_GT(frame.NearestDistance(picture, ahead, -0.2 * ahead, kWhite), 60) << ahead;
    EXPECT_GT(frame.NearestDistance(picture, ahead, 0.0, kWhite), 60) << ahead;
  }
}

TEST(ScenePlotTest, DrawsNothingWhiteWithoutAFuture) {
  v1::Scenario scenario = Scene();
  auto* states = scenario.mutable_agents(0)->mutable_states();
  states->erase(states->begin() + 1, states->end());
  const cv::Mat picture = Decode(*DrawScene(scenario, Answer(0.9), Options()));
  const PictureFrame frame(picture);
  EXPECT_GT(frame.NearestDistance(picture, 25.0, 5.0, kWhite), 60);
}

// Returns a scene with a lane through the target along its heading, a lane beside it that it cannot
// reach, and a leader 30 m ahead.
v1::Scenario SceneWithLanes() {
  v1::Scenario scenario = Scene();
  const scene::Pose2 X_WT(100.0, 50.0, kHeading);
  for (const double left : {0.0, 15.0}) {
    v1::MapFeature* lane = scenario.add_map_features();
    lane->set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
    for (const double ahead : {-50.0, 150.0}) {
      const scene::Point2 point = X_WT * scene::Point2{ahead, left};
      lane->add_x(point.x);
      lane->add_y(point.y);
    }
  }
  v1::Agent* leader = scenario.add_agents();
  leader->set_id(8);
  leader->set_length(4.0);
  leader->set_width(2.0);
  v1::AgentState* state = leader->add_states();
  const scene::Point2 place = X_WT * scene::Point2{30.0, 0.0};
  state->set_time(1.0);
  state->set_x(place.x);
  state->set_y(place.y);
  state->set_heading(static_cast<float>(kHeading));
  return scenario;
}

TEST(ScenePlotTest, DrawsLanePathsIfAskedFor) {
  constexpr Color kTurquoise = {64, 196, 188};
  ScenePlotOptions options = Options();
  for (const bool asked : {true, false}) {
    options.lane_paths = asked;
    const cv::Mat picture = Decode(*DrawScene(SceneWithLanes(), Answer(0.9), options));
    const PictureFrame frame(picture);
    for (const double ahead : {12.0, 20.0, 38.0}) {
      EXPECT_EQ(frame.NearestDistance(picture, ahead, 0.0, kTurquoise) < 40, asked) << ahead;
      EXPECT_GT(frame.NearestDistance(picture, ahead, 15.0, kTurquoise), 60) << ahead;
    }
    // The ring around the leader, beside the path.
    int nearest = 255;
    for (double left = 2.0; left < 5.0; left += 0.1) {
      nearest = std::min(nearest, frame.NearestDistance(picture, 30.0, left, kTurquoise));
    }
    EXPECT_EQ(nearest < 60, asked);
  }
}

// Returns the picture of a scene with lane paths and without an answer.
cv::Mat LanePathsWithoutActions() {
  ScenePlotOptions options = Options();
  options.lane_paths = true;
  v1::ScenarioPrediction nothing;
  nothing.add_targets()->set_target_id(7);
  return Decode(*DrawScene(SceneWithLanes(), nothing, options));
}

TEST(ScenePlotTest, ShowsWholePathsWithoutActions) {
  const cv::Mat picture = LanePathsWithoutActions();
  const PictureFrame frame(picture);
  EXPECT_LT(frame.NearestDistance(picture, 95.0, 0.0, {64, 196, 188}), 40);
}

TEST(ScenePlotTest, TheLegendOfAPanelWithoutActionsStaysWithinItsAxes) {
  const cv::Mat picture = LanePathsWithoutActions();
  const cv::Mat beside = picture(cv::Rect(picture.cols - 14, 50, 14, 200));
  const cv::Vec3b ground = picture.at<cv::Vec3b>(0, picture.cols - 1);
  const cv::Mat even(beside.size(), beside.type(), cv::Scalar(ground[0], ground[1], ground[2]));
  EXPECT_EQ(cv::norm(beside, even, cv::NORM_INF), 0.0);
}

TEST(ScenePlotTest, TruthEndsAtTheHorizon) {
  ScenePlotOptions options = Options();
  options.horizon = 2.5;  // as far as (20, 4)
  const cv::Mat picture = Decode(*DrawScene(Scene(), Answer(0.9), options));
  const PictureFrame frame(picture);
  EXPECT_LT(frame.NearestDistance(picture, 15.0, 3.0, kWhite), 12);
  EXPECT_GT(frame.NearestDistance(picture, 30.0, 6.0, kWhite), 60);
}

TEST(ScenePlotTest, WorldAndTargetFramesGiveTheSamePicture) {
  v1::ScenarioPrediction world = Answer(0.9);
  v1::ActionDistribution* action = world.mutable_targets(0)->mutable_distributions(0);
  const auto move = [](v1::Trajectory* trajectory) {
    for (int i = 0; i < trajectory->x_size(); ++i) {
      const double ahead = trajectory->x(i);
      const double left = trajectory->y(i);
      trajectory->set_x(i, 100.0 + std::cos(kHeading) * ahead - std::sin(kHeading) * left);
      trajectory->set_y(i, 50.0 + std::sin(kHeading) * ahead + std::cos(kHeading) * left);
    }
  };
  move(action->mutable_mean_trajectory());
  move(action->mutable_sigma_trajectories(0));
  ScenePlotOptions options = Options();
  options.frame = v1::FRAME_WORLD;
  const cv::Mat a = Decode(*DrawScene(Scene(), world, options));
  const cv::Mat b = Decode(*DrawScene(Scene(), Answer(0.9), Options()));
  EXPECT_LT(cv::norm(a, b, cv::NORM_INF), 40.0);  // the float heading moves points by a hair
}

TEST(ScenePlotTest, DoesNotDrawImprobableActions) {
  const cv::Mat picture = Decode(*DrawScene(Scene(), Answer(0.04), Options()));
  const PictureFrame frame(picture);
  EXPECT_GT(frame.NearestDistance(picture, 25.0, -5.0, ActionColor(2)), 60);
}

// Adds an action straight to (40, left) in the target's frame with probability 4 %.
void AddImprobableAction(int id, double left, v1::ScenarioPrediction* prediction) {
  v1::ActionDistribution* action = prediction->mutable_targets(0)->add_distributions();
  action->set_action_id(id);
  action->set_probability(0.04);
  for (int i = 1; i <= 10; ++i) {
    action->mutable_mean_trajectory()->add_x(4.0 * i);
    action->mutable_mean_trajectory()->add_y(0.1 * left * i);
  }
}

void AddRepresentative(int id, double weight, v1::ScenarioPrediction* prediction) {
  v1::Representative* representative = prediction->mutable_targets(0)->add_representatives();
  representative->set_action_id(id);
  representative->set_weight(weight);
}

TEST(ScenePlotTest, DrawsImprobableRepresentativesAndAWhiteRingOnTheMedoid) {
  v1::ScenarioPrediction answer = Answer(0.9);
  AddImprobableAction(4, -16.0, &answer);
  AddImprobableAction(6, 16.0, &answer);
  AddImprobableAction(8, -24.0, &answer);
  AddRepresentative(4, 0.7, &answer);
  AddRepresentative(6, 0.3, &answer);
  const cv::Mat picture = Decode(*DrawScene(Scene(), answer, Options()));
  const PictureFrame frame(picture);
  EXPECT_LT(frame.NearestDistance(picture, 25.0, -10.0, ActionColor(4)), 12);
  EXPECT_LT(frame.NearestDistance(picture, 25.0, 10.0, ActionColor(6)), 12);
  EXPECT_GT(frame.NearestDistance(picture, 25.0, -15.0, ActionColor(8)), 60);  // 4 %, and not one
  // White around the disc at the end of the mean.
  const auto ring = [&](double slope) {
    int nearest = 255;
    for (double ahead = 36.0; ahead < 46.0; ahead += 0.25) {
      nearest = std::min(nearest, frame.NearestDistance(picture, ahead, slope * ahead, kWhite));
    }
    return nearest;
  };
  EXPECT_LT(ring(-0.4), 60);
  EXPECT_GT(ring(0.4), 60);
}

TEST(ScenePlotTest, DrawsActionsBesideTheRepresentativesFaintly) {
  v1::ScenarioPrediction answer = Answer(0.9);
  AddImprobableAction(4, 16.0, &answer);
  const cv::Mat before = Decode(*DrawScene(Scene(), answer, Options()));
  AddRepresentative(4, 1.0, &answer);
  const cv::Mat after = Decode(*DrawScene(Scene(), answer, Options()));
  EXPECT_LT(PictureFrame(before).NearestDistance(before, 25.0, -5.0, ActionColor(2)), 12);
  const int faint = PictureFrame(after).NearestDistance(after, 25.0, -5.0, ActionColor(2));
  EXPECT_GT(faint, 20);
  EXPECT_LT(faint, 160);  // and still there
}

// Two vehicles, of which the second comes from the left; in the first combination it goes on, in
// the second it stays.
v1::ScenarioPrediction JointAnswer() {
  v1::ScenarioPrediction answer = Answer(0.9);
  v1::TargetPrediction* other = answer.add_targets();
  other->set_target_id(8);
  for (const int id : {5, 6}) {
    v1::ActionDistribution* action = other->add_distributions();
    action->set_action_id(id);
    for (int i = 1; i <= 10; ++i) {
      action->mutable_mean_trajectory()->add_x(id == 5 ? 2.0 * i : 0.02 * i);
      action->mutable_mean_trajectory()->add_y(0.0);
    }
  }
  v1::JointPrediction* joint = answer.mutable_joint();
  joint->add_target_ids(7);
  joint->add_target_ids(8);
  for (const int id : {5, 6}) {
    v1::JointCombination* combination = joint->add_combinations();
    combination->add_action_ids(2);
    combination->add_action_ids(id);
    combination->set_weight(0.5);
  }
  return answer;
}
v1::Scenario JointScene() {
  v1::Scenario scene = Scene();
  v1::Agent* other = scene.add_agents();
  *other = scene.agents(0);
  other->set_id(8);
  for (v1::AgentState& state : *other->mutable_states()) {
    state.set_x(100.0 - 20.0 * std::sin(kHeading));
    state.set_y(50.0 + 20.0 * std::cos(kHeading));
  }
  scene.add_target_ids(8);
  return scene;
}

TEST(ScenePlotTest, DrawsAPanelForEachCombination) {
  ScenePlotOptions options = Options();
  options.width = 0;
  options.height = 0;
  const v1::ScenarioPrediction answer = JointAnswer();
  const cv::Mat picture = Decode(*DrawScene(JointScene(), answer, options));
  ASSERT_EQ(picture.cols, 2000);
  ASSERT_EQ(picture.rows, 700);
  const auto colored = [&](int panel, int number) {
    return CountColor(picture(cv::Rect(1000 * panel, 0, 1000, 700)), ActionColor(number));
  };
  // Each target has its own colour, and the second one drives in the first panel alone.
  EXPECT_GT(colored(0, 0), 500);
  EXPECT_NEAR(colored(0, 0), colored(1, 0), 200);
  EXPECT_GT(colored(0, 1), colored(1, 1) + 300);
}

TEST(ScenePlotTest, RefusesCombinationsThatItCannotDraw) {
  v1::ScenarioPrediction unknown = JointAnswer();
  unknown.mutable_joint()->set_target_ids(1, 9);
  EXPECT_TRUE(DrawScene(JointScene(), unknown, Options()).ok());  // it is not in sight
  unknown = JointAnswer();
  unknown.mutable_joint()->mutable_combinations(1)->set_action_ids(1, 3);
  EXPECT_TRUE(absl::IsInvalidArgument(DrawScene(JointScene(), unknown, Options()).status()));
  unknown = JointAnswer();
  unknown.mutable_targets(1)->set_target_id(9);
  EXPECT_TRUE(absl::IsInvalidArgument(DrawScene(JointScene(), unknown, Options()).status()));
}

TEST(ScenePlotTest, RefusesWhatItCannotDraw) {
  v1::ScenarioPrediction uneven = Answer(0.9);
  uneven.mutable_targets(0)->mutable_distributions(0)->mutable_mean_trajectory()->add_x(1.0);
  EXPECT_TRUE(absl::IsInvalidArgument(DrawScene(Scene(), uneven, Options()).status()));
  v1::ScenarioPrediction refused = Answer(0.9);
  refused.mutable_targets(0)->mutable_error()->set_code(3);
  EXPECT_TRUE(absl::IsInvalidArgument(DrawScene(Scene(), refused, Options()).status()));
  ScenePlotOptions tiny = Options();
  tiny.width = 10;
  EXPECT_TRUE(absl::IsInvalidArgument(DrawScene(Scene(), Answer(0.9), tiny).status()));
}

TEST(PictureSizeTest, ManyPanelsBecomeSmaller) {
  const PictureSize most = SizeFor(ShapeOf(144), 1000.0, 700.0);
  EXPECT_EQ(most.width, 12'000);
  EXPECT_EQ(most.height, 8'400);
  for (const int panels : {145, 1'000, 5'000}) {
    const PictureSize size = SizeFor(ShapeOf(panels), 1000.0, 700.0);
    EXPECT_TRUE(CheckSize(size.width, size.height).ok()) << panels;
    EXPECT_GT(size.width, 11'900) << panels;
  }
}

TEST(ScenePlotTest, DrawsASceneAMillionMetresAwayTheSame) {
  v1::Scenario far = Scene();
  for (v1::AgentState& state : *far.mutable_agents(0)->mutable_states()) {
    state.set_x(state.x() + 1e6);
    state.set_y(state.y() - 1e6);
  }
  const cv::Mat a = Decode(*DrawScene(far, Answer(0.9), Options()));
  const cv::Mat b = Decode(*DrawScene(Scene(), Answer(0.9), Options()));
  EXPECT_LT(cv::norm(a, b, cv::NORM_INF), 40.0);
}

v1::ActionSet TwoActions() {
  v1::ActionSet set;
  for (const bool effective : {true, false}) {
    v1::Action* action = set.add_actions();
    action->set_action_id(effective ? 0 : 1);
    action->set_effective(effective);
    *action->mutable_distribution() = Answer(0.5).targets(0).distributions(0);
  }
  set.add_waypoint_times(5.0);
  return set;
}

TEST(ActionSetPlotTest, DrawsTheEffectiveActions) {
  const auto one = DrawActionSet(TwoActions(), {});
  const auto both = DrawActionSet(TwoActions(), {.all = true});
  ASSERT_TRUE(one.ok() && both.ok());
  v1::ActionSet effective_alone = TwoActions();
  effective_alone.mutable_actions(1)->set_action_id(9);  // not drawn, so nothing changes
  EXPECT_EQ(*DrawActionSet(effective_alone, {}), *one);
  EXPECT_NE(*both, *one);
  EXPECT_EQ(*DrawActionSet(TwoActions(), {}), *one);
}

TEST(ActionSetPlotTest, IsAPngOfTheRequestedSize) {
  const cv::Mat picture = Decode(*DrawActionSet(TwoActions(), {.width = 800, .height = 640}));
  EXPECT_EQ(picture.cols, 800);
  EXPECT_EQ(picture.rows, 640);
}

// Returns an action set with this many latent dimensions; each action has 1 + 2 * dimensions sigma
// trajectories.
v1::ActionSet SixActions(int dimensions) {
  v1::ActionSet set;
  for (int id = 0; id < 6; ++id) {
    v1::Action* action = set.add_actions();
    action->set_action_id(id);
    action->set_effective(true);
    v1::Trajectory mean;
    mean.add_x(10.0);
    mean.add_y(id);
    for (int i = 0; i < 1 + 2 * dimensions; ++i) {
      *action->mutable_distribution()->add_sigma_trajectories() = mean;
    }
    *action->mutable_distribution()->mutable_mean_trajectory() = mean;
  }
  return set;
}

TEST(ActionSetPlotTest, KeepsTheKeyOfManyDimensionsApartFromTheNote) {
  // With one dimension the key is short and the note stands alone on the right.
  const cv::Mat few = Decode(*DrawActionSet(SixActions(1), {}));
  const cv::Mat many = Decode(*DrawActionSet(SixActions(8), {}));
  ASSERT_EQ(few.cols, many.cols);
  const cv::Rect note(500, 48, few.cols - 500, 20);
  const cv::Mat blank(note.height, note.width, few.type(), cv::Scalar::all(255));
  ASSERT_GT(cv::norm(few(note), blank, cv::NORM_INF), 100.0);
  bool is_there = false;
  for (int down = 0; down < 100; ++down) {
    const cv::Rect moved(note.x, note.y + down, note.width, note.height);
    is_there |= cv::norm(few(note), many(moved), cv::NORM_INF) == 0.0;
  }
  EXPECT_TRUE(is_there);
}

TEST(ActionSetPlotTest, RefusesAnEmptySet) {
  EXPECT_TRUE(absl::IsInvalidArgument(DrawActionSet({}, {}).status()));
}

TEST(ActionSetPlotTest, DrawsTheDisplayNameOfAnAction) {
  v1::ActionSet named = TwoActions();
  named.mutable_actions(0)->set_display_name("left turn");
  const std::string picture = *DrawActionSet(named, {});
  EXPECT_NE(picture, *DrawActionSet(TwoActions(), {}));
  named.mutable_actions(0)->set_derived_name("bear left");  // what is shown is the display name
  EXPECT_EQ(picture, *DrawActionSet(named, {}));
}

v1::ActionSet TwoActionsAt(double speed) {
  v1::ActionSet set = TwoActions();
  set.set_speed(speed);
  return set;
}

TEST(ActionGalleryPlotTest, DrawsAPanelForEachSpeed) {
  const std::vector<v1::ActionSet> sets = {TwoActionsAt(0.0), TwoActionsAt(5.0), TwoActionsAt(10.0),
                                           TwoActionsAt(20.0)};
  const auto all_four = DrawActionGallery(sets, {});
  ASSERT_TRUE(all_four.ok()) << all_four.status();
  const cv::Mat picture = Decode(*all_four);
  EXPECT_EQ(picture.cols, 1500);
  EXPECT_EQ(picture.rows, 1000);
  EXPECT_EQ(*DrawActionGallery(sets, {}), *all_four);
  // The second set's panel is in the upper right quarter, left of the legend, and nowhere else.
  std::vector<v1::ActionSet> others = sets;
  others[1].mutable_actions(0)->mutable_distribution()->mutable_mean_trajectory()->set_y(0, 9.0);
  const cv::Mat other = Decode(*DrawActionGallery(others, {}));
  const cv::Rect panel(625, 74, 625, 463);
  EXPECT_GT(cv::norm(picture(panel), other(panel), cv::NORM_INF), 50.0);
  cv::Mat rest = other.clone();
  picture(panel).copyTo(rest(panel));
  EXPECT_EQ(cv::norm(picture, rest, cv::NORM_INF), 0.0);
}

TEST(ActionGalleryPlotTest, ItsLegendListsWhatFitsWithoutOverlap) {
  v1::ActionSet set;
  for (int id = 0; id < 100; ++id) {
    v1::Action* action = set.add_actions();
    action->set_action_id(id);
    *action->mutable_distribution() = Answer(0.5).targets(0).distributions(0);
  }
  set.set_speed(10.0);
  const cv::Mat picture = Decode(*DrawActionGallery({&set, 1}, {}));
  // Where the ids are, at the right of the panels: blank rows part them.
  const cv::Mat ids = picture(cv::Rect(1288, 80, 16, 910));
  const cv::Mat blank(1, ids.cols, ids.type(), cv::Scalar::all(255));
  int lines = 0;
  bool was_blank = true;
  for (int y = 0; y < ids.rows; ++y) {
    const bool is_blank = cv::norm(ids.row(y), blank, cv::NORM_INF) < 4.0;
    lines += was_blank && !is_blank ? 1 : 0;
    was_blank = is_blank;
  }
  EXPECT_GT(lines, 50);
  EXPECT_LT(lines, 100);
}

TEST(ActionGalleryPlotTest, ALongNameInItsLegendEndsBeforeTheUsage) {
  std::vector<v1::ActionSet> sets = {TwoActionsAt(10.0)};
  sets[0].mutable_actions(0)->set_display_name(std::string(64, 'e'));  // as long as a label may be
  sets[0].mutable_actions(0)->set_usage(0.5);
  const cv::Mat picture = Decode(*DrawActionGallery(sets, {}));
  // The legend ends at 1480, and its "50.0 %" takes the last 48 pixels.
  const cv::Mat gap = picture(cv::Rect(1424, 104, 6, 860));
  EXPECT_EQ(CountColor(gap, kWhite), gap.rows * gap.cols);
}

TEST(ActionGalleryPlotTest, LeavesOutActionsThatAreNotEffective) {
  const std::vector<v1::ActionSet> sets = {TwoActionsAt(10.0)};
  EXPECT_NE(*DrawActionGallery(sets, {}), *DrawActionGallery(sets, {.all = true}));
}

TEST(ActionGalleryPlotTest, RefusesSetsThatItCannotDraw) {
  EXPECT_TRUE(absl::IsInvalidArgument(DrawActionGallery({}, {}).status()));
  std::vector<v1::ActionSet> sets = {TwoActions()};  // of no speed
  EXPECT_TRUE(absl::IsInvalidArgument(DrawActionGallery(sets, {}).status()));
  sets = {TwoActionsAt(5.0)};
  sets[0].mutable_actions(0)->mutable_distribution()->mutable_mean_trajectory()->add_x(1.0);
  EXPECT_TRUE(absl::IsInvalidArgument(DrawActionGallery(sets, {}).status()));
}

TEST(LabelPlacerTest, PlacesLabelsInsideWithoutOverlap) {
  const Box whole{100.0, 100.0, 200.0, 120.0};
  LabelPlacer placer(whole);
  placer.Occupy(Box{150.0, 100.0, 60.0, 120.0});
  std::vector<Box> placed;
  for (int i = 0; i < 40; ++i) {
    const auto place = placer.Place({140.0, 160.0}, "12", 10.0, 150.0);
    if (!place) continue;
    EXPECT_GE(place->frame.left, whole.left);
    EXPECT_LE(place->frame.right(), whole.right());
    EXPECT_GE(place->frame.top, whole.top);
    EXPECT_LE(place->frame.bottom(), whole.bottom());
    placed.push_back(place->frame);
  }
  placed.push_back({150.0, 100.0, 60.0, 120.0});
  EXPECT_GT(placed.size(), 3u);
  EXPECT_LT(placed.size(), 40u);  // not all of them fit
  for (size_t i = 0; i < placed.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      EXPECT_TRUE(placed[i].left >= placed[j].right() || placed[j].left >= placed[i].right() ||
                  placed[i].top >= placed[j].bottom() || placed[j].top >= placed[i].bottom());
    }
  }
}

TEST(LabelPlacerTest, PlacesNothingOverALine) {
  LabelPlacer placer({0.0, 0.0, 400.0, 400.0});
  placer.Occupy(Line{{0.0, 200.0}, {400.0, 200.0}}, 10.0);
  for (int i = 0; i < 10; ++i) {
    const auto place = placer.Place({200.0, 200.0}, "7", 10.0, 100.0);
    ASSERT_TRUE(place);
    EXPECT_TRUE(place->frame.top >= 205.0 || place->frame.bottom() <= 195.0);
  }
}

TEST(AxesTest, BothAxesShareAScaleAndContainTheExtent) {
  const Axes axes({100.0, 50.0, 400.0, 200.0}, {0.0, 20.0, -30.0, 10.0});
  EXPECT_NEAR(axes.pixels_per_meter(), 5.0, 1e-9);  // 40 m on 200 pixels
  EXPECT_NEAR(axes.ToPixel(10.0, -10.0).x, 300.0, 1e-9);
  EXPECT_NEAR(axes.ToPixel(10.0, -10.0).y, 150.0, 1e-9);
  EXPECT_NEAR(axes.ToPixel(0.0, 10.0).y, 50.0, 1e-9);  // left is up
}

TEST(AxesTest, TicksAreRoundNumbers) {
  EXPECT_EQ(Ticks(-3.0, 12.0, 4), (std::vector<double>{0.0, 5.0, 10.0}));
  EXPECT_EQ(Ticks(0.0, 1.0, 5), (std::vector<double>{0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0}));
  EXPECT_EQ(TickText(0.2, 0.2), "0.2");
  EXPECT_EQ(TickText(-10.0, 5.0), "-10");
}

}  // namespace
}  // namespace maneuver::plot::plot_test
