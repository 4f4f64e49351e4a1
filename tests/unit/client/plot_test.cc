#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <tuple>
#include <vector>

#include "client/plot/action_means_plot.h"
#include "client/plot/action_set_plot.h"
#include "client/plot/axes.h"
#include "client/plot/canvas.h"
#include "client/plot/label_placer.h"
#include "client/plot/posterior_plot.h"
#include "client/plot/reliability_plot.h"
#include "client/plot/scene_plot.h"

namespace maneuver::plot {
namespace {

cv::Mat Decode(const std::string& png) {
  const std::vector<uint8_t> bytes(png.begin(), png.end());
  return cv::imdecode(bytes, cv::IMREAD_COLOR);
}

// How far a pixel's colour is from `color`, in its worst channel.
int Distance(const cv::Vec3b& bgr, Color color) {
  return std::max({std::abs(bgr[2] - color.red), std::abs(bgr[1] - color.green),
                   std::abs(bgr[0] - color.blue)});
}

constexpr double kHeading = 0.5;

// A long vehicle at (100, 50) with a heading of half a radian, which then drives straight from (0,
// 0) to (40, 8) of its frame in 5 s.
v1::Scenario Scene() {
  v1::Scenario scenario;
  scenario.set_scenario_id("scene");
  scenario.set_prediction_time(1.0);
  scenario.add_target_ids(7);
  v1::Agent* agent = scenario.add_agents();
  agent->set_id(7);
  agent->set_length(10.0);
  agent->set_width(4.0);
  for (int i = 0; i <= 10; ++i) {
    const double ahead = 4.0 * i;
    const double left = 0.8 * i;
    v1::AgentState* state = agent->add_states();
    state->set_time(1.0 + 0.5 * i);
    state->set_x(100.0 + std::cos(kHeading) * ahead - std::sin(kHeading) * left);
    state->set_y(50.0 + std::sin(kHeading) * ahead + std::cos(kHeading) * left);
    state->set_heading(static_cast<float>(kHeading));
  }
  return scenario;
}

// One action, straight to (40, -8) of the target's frame.
v1::ScenarioPrediction Answer(double probability) {
  v1::ScenarioPrediction prediction;
  v1::TargetPrediction* target = prediction.add_targets();
  target->set_target_id(7);
  v1::ActionDistribution* action = target->add_distributions();
  action->set_action_id(2);
  action->set_probability(probability);
  for (int i = 1; i <= 10; ++i) {
    action->mutable_mean_trajectory()->add_x(4.0 * i);
    action->mutable_mean_trajectory()->add_y(-0.8 * i);
  }
  *action->add_sigma_trajectories() = action->mean_trajectory();
  return prediction;
}

ScenePlotOptions Options() {
  ScenePlotOptions options;
  options.width = 900;
  options.height = 600;
  options.frame = v1::FRAME_TARGET;
  return options;
}

// Where a point of the target's frame lies in a picture, read off the picture itself: the target's
// box is the only large patch of its yellow, 10 m by 4 m about the origin.
class PictureFrame {
 public:
  explicit PictureFrame(const cv::Mat& picture) {
    constexpr Color kYellow = {255, 214, 10};
    int left = 1 << 20;
    int right = 0;
    int top = 1 << 20;
    int bottom = 0;
    for (int y = 0; y < picture.rows; ++y) {
      for (int x = 0; x < picture.cols; ++x) {
        // Rows and columns of the box; the legend's line is thinner.
        if (y < 2 || y + 2 >= picture.rows) continue;
        bool patch = true;
        for (int dy = -2; dy <= 2; ++dy) {
          patch &= Distance(picture.at<cv::Vec3b>(y + dy, x), kYellow) < 60;
        }
        if (!patch) continue;
        left = std::min(left, x);
        right = std::max(right, x);
        top = std::min(top, y - 2);
        bottom = std::max(bottom, y + 2);
      }
    }
    center_x_ = (left + right) / 2.0;
    center_y_ = (top + bottom) / 2.0;
    scale_ = (right - left) / 10.0;
  }

  // The pixel nearest to `color` among those within two of where (ahead, left) lies.
  int NearestDistance(const cv::Mat& picture, double ahead, double left, Color color) const {
    const int x = static_cast<int>(std::lround(center_x_ + ahead * scale_));
    const int y = static_cast<int>(std::lround(center_y_ - left * scale_));
    int nearest = 255;
    for (int dy = -2; dy <= 2; ++dy) {
      for (int dx = -2; dx <= 2; ++dx) {
        nearest = std::min(nearest, Distance(picture.at<cv::Vec3b>(y + dy, x + dx), color));
      }
    }
    return nearest;
  }

 private:
  double center_x_ = 0.0;
  double center_y_ = 0.0;
  double scale_ = 0.0;
};

constexpr Color kWhite = {255, 255, 255};

TEST(ScenePlotTest, IsAPngOfTheSizeAskedFor) {
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

TEST(ScenePlotTest, TruthIsWhiteAndTheActionItsColourWhereTheyLie) {
  const cv::Mat picture = Decode(*DrawScene(Scene(), Answer(0.9), Options()));
  const PictureFrame frame(picture);
  for (const double ahead : {15.0, 25.0, 35.0}) {
    EXPECT_LT(frame.NearestDistance(picture, ahead, 0.2 * ahead, kWhite), 12) << ahead;
    EXPECT_LT(frame.NearestDistance(picture, ahead, -0.2 * ahead, ActionColor(2)), 12) << ahead;
    EXPECT_GT(frame.NearestDistance(picture, ahead, -0.2 * ahead, kWhite), 60) << ahead;
    EXPECT_GT(frame.NearestDistance(picture, ahead, 0.0, kWhite), 60) << ahead;
  }
}

TEST(ScenePlotTest, WithoutAFutureNothingIsWhite) {
  v1::Scenario scenario = Scene();
  auto* states = scenario.mutable_agents(0)->mutable_states();
  states->erase(states->begin() + 1, states->end());
  const cv::Mat picture = Decode(*DrawScene(scenario, Answer(0.9), Options()));
  const PictureFrame frame(picture);
  EXPECT_GT(frame.NearestDistance(picture, 25.0, 5.0, kWhite), 60);
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

TEST(ScenePlotTest, ImprobableActionsAreNotDrawn) {
  const cv::Mat picture = Decode(*DrawScene(Scene(), Answer(0.04), Options()));
  const PictureFrame frame(picture);
  EXPECT_GT(frame.NearestDistance(picture, 25.0, -5.0, ActionColor(2)), 60);
}

TEST(ScenePlotTest, WhatCannotBeDrawnIsRefused) {
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

TEST(ScenePlotTest, ASceneAMillionMetresAwayIsDrawnAlike) {
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
  effective_alone.mutable_actions(1)->set_action_id(9);  // not drawn: nothing changes
  EXPECT_EQ(*DrawActionSet(effective_alone, {}), *one);
  EXPECT_NE(*both, *one);
  EXPECT_EQ(*DrawActionSet(TwoActions(), {}), *one);
}

TEST(ActionSetPlotTest, IsAPngOfTheSizeAskedFor) {
  const cv::Mat picture = Decode(*DrawActionSet(TwoActions(), {.width = 800, .height = 640}));
  EXPECT_EQ(picture.cols, 800);
  EXPECT_EQ(picture.rows, 640);
}

TEST(ActionSetPlotTest, AnEmptySetIsRefused) {
  EXPECT_TRUE(absl::IsInvalidArgument(DrawActionSet({}, {}).status()));
}

TEST(ActionSetPlotTest, ANameIsDrawnWhereThereIsNoLabel) {
  v1::ActionSet labelled = TwoActions();
  labelled.mutable_actions(0)->set_label("left turn");
  const std::string picture = *DrawActionSet(labelled, {});
  EXPECT_NE(picture, *DrawActionSet(TwoActions(), {}));
  EXPECT_EQ(picture, *DrawActionSet(TwoActions(), {.names = {{0, "left turn"}}}));
  EXPECT_EQ(picture, *DrawActionSet(labelled, {.names = {{0, "right turn"}}}));
}

// One action as in Answer, whose sigma trajectories end `spread` metres to each side.
v1::ScenarioPrediction Spread(double spread) {
  v1::ScenarioPrediction prediction = Answer(0.9);
  v1::ActionDistribution* action = prediction.mutable_targets(0)->mutable_distributions(0);
  for (const double side : {1.0, -1.0}) {
    v1::Trajectory* sigma = action->add_sigma_trajectories();
    *sigma = action->mean_trajectory();
    for (int i = 0; i < sigma->y_size(); ++i) {
      sigma->set_y(i, sigma->y(i) + side * spread * (i + 1) / sigma->y_size());
    }
  }
  return prediction;
}

TEST(PosteriorPlotTest, WideIsLeftAndNarrowRightAtTheSameScale) {
  ScenePlotOptions options = Options();
  options.width = 1400;
  options.height = 800;
  const auto png = DrawGenericAndPosterior(Scene(), Spread(10.0), Spread(1.0), options);
  ASSERT_TRUE(png.ok()) << png.status();
  const cv::Mat picture = Decode(*png);
  const cv::Mat left = picture.colRange(0, 700);
  const cv::Mat right = picture.colRange(700, 1400);
  const PictureFrame left_frame(left);
  const PictureFrame right_frame(right);
  // The outermost sigma trajectory at 30 m ahead, drawn thin.
  const Color color = ActionColor(2);
  const double outermost = -0.2 * 30.0 - 10.0 * 0.75;
  EXPECT_LT(left_frame.NearestDistance(left, 30.0, outermost, color), 150);
  EXPECT_GT(right_frame.NearestDistance(right, 30.0, outermost, color), 180);
  for (const double ahead : {15.0, 25.0, 35.0}) {  // mean and truth are where they are
    EXPECT_LT(left_frame.NearestDistance(left, ahead, -0.2 * ahead, color), 12);
    EXPECT_LT(right_frame.NearestDistance(right, ahead, -0.2 * ahead, color), 12);
    EXPECT_LT(right_frame.NearestDistance(right, ahead, 0.2 * ahead, kWhite), 12);
  }
}

TEST(PosteriorPlotTest, WhatWasNotAnsweredTwiceIsRefused) {
  v1::ScenarioPrediction other = Answer(0.9);
  other.mutable_targets(0)->set_target_id(8);
  EXPECT_TRUE(absl::IsInvalidArgument(
      DrawGenericAndPosterior(Scene(), Answer(0.9), other, Options()).status()));
  v1::ScenarioPrediction uneven = Answer(0.9);
  uneven.mutable_targets(0)->mutable_distributions(0)->mutable_mean_trajectory()->add_x(1.0);
  EXPECT_TRUE(absl::IsInvalidArgument(
      DrawGenericAndPosterior(Scene(), Answer(0.9), uneven, Options()).status()));
}

// Of two actions: two examples, both most likely the first.
v1::EvaluationReport Report() {
  v1::EvaluationReport report;
  for (const double p : {0.9, 0.1}) report.add_action_uses()->set_probability(p);
  report.mutable_action_uses(0)->set_kinematic_class("left_turn");
  for (int i = 0; i < 2; ++i) {
    v1::EvaluatedExample* example = report.add_sampled_examples();
    for (const double x : {15.0, 30.0}) {
      example->mutable_trajectory()->add_x(x);
      example->mutable_trajectory()->add_y((i + 1) * x / 2.0);
    }
    example->add_responsibilities(0.8);
    example->add_responsibilities(0.2);
  }
  report.mutable_metrics()->insert({"calibration_error", 0.1});
  for (int i = 0; i < 10; ++i) {
    v1::ReliabilityBin* bin = report.add_reliability();
    bin->set_lower(i / 10.0);
    bin->set_upper((i + 1) / 10.0);
  }
  for (const auto& [bin, confidence, responsibility] :
       {std::tuple{3, 0.35, 0.60}, std::tuple{8, 0.85, 0.70}}) {
    report.mutable_reliability(bin)->set_examples(10 * bin);
    report.mutable_reliability(bin)->set_mean_confidence(confidence);
    report.mutable_reliability(bin)->set_mean_responsibility(responsibility);
  }
  return report;
}

v1::ActionSet TwoMeans() {
  v1::ActionSet set;
  for (const double end : {40.0, 90.0}) {
    v1::Action* action = set.add_actions();
    action->set_action_id(set.actions_size() - 1);
    action->set_effective(true);
    for (const double share : {0.5, 1.0}) {
      action->mutable_distribution()->mutable_mean_trajectory()->add_x(share * end);
      action->mutable_distribution()->mutable_mean_trajectory()->add_y(0.0);
    }
  }
  return set;
}

int Count(const cv::Mat& picture, Color color, int nearness) {
  int count = 0;
  for (int y = 0; y < picture.rows; ++y) {
    // Without the legend.
    for (int x = 0; x < 1200; ++x) {
      count += Distance(picture.at<cv::Vec3b>(y, x), color) < nearness ? 1 : 0;
    }
  }
  return count;
}

TEST(ActionMeansPlotTest, TrajectoriesHaveTheColourOfTheirMostResponsibleAction) {
  // The first colour goes to the most frequent action, the next to the other one.
  const Color first = LatentColor(0);
  const Color second = LatentColor(1);
  const auto blend = [](Color c) {  // as a thin line looks on white
    return Color{255 - (255 - c.red) * 42 / 100, 255 - (255 - c.green) * 42 / 100,
                 255 - (255 - c.blue) * 42 / 100};
  };
  v1::EvaluationReport report = Report();
  const cv::Mat all_first = Decode(*DrawActionMeans(TwoMeans(), report));
  EXPECT_GT(Count(all_first, first, 10), 200);   // the mean
  EXPECT_GT(Count(all_first, second, 10), 200);  // the other mean
  EXPECT_GT(Count(all_first, blend(first), 12), 200);
  EXPECT_LT(Count(all_first, blend(second), 12), 100);
  report.mutable_sampled_examples(1)->set_responsibilities(1, 0.9);
  const cv::Mat one_each = Decode(*DrawActionMeans(TwoMeans(), report));
  EXPECT_GT(Count(one_each, blend(second), 12), 200);
}

TEST(ActionMeansPlotTest, IdleActionsAreLeftOut) {
  v1::ActionSet set = TwoMeans();
  set.mutable_actions(1)->set_effective(false);
  const cv::Mat picture = Decode(*DrawActionMeans(set, Report()));
  EXPECT_LT(Count(picture, LatentColor(1), 10), 50);
}

TEST(ActionMeansPlotTest, WhatCannotBeDrawnIsRefused) {
  EXPECT_TRUE(absl::IsInvalidArgument(DrawActionMeans({}, Report()).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(DrawActionMeans(TwoMeans(), {}).status()));
  v1::EvaluationReport uneven = Report();
  uneven.mutable_sampled_examples(0)->mutable_trajectory()->add_x(1.0);
  EXPECT_TRUE(absl::IsInvalidArgument(DrawActionMeans(TwoMeans(), uneven).status()));
}

TEST(ReliabilityPlotTest, PointsLieWhereTheTableSays) {
  const cv::Mat picture = Decode(*DrawReliability(Report()));
  // The curve's square is 590 pixels wide and begins at (96, 92).
  const auto at = [&](double x, double y) {
    return picture.at<cv::Vec3b>(static_cast<int>(std::lround(92.0 + 590.0 * (1.0 - y))),
                                 static_cast<int>(std::lround(96.0 + 590.0 * x)));
  };
  EXPECT_LT(Distance(at(0.35, 0.60), LatentColor(0)), 12);
  EXPECT_LT(Distance(at(0.85, 0.70), LatentColor(0)), 12);
  EXPECT_LT(Distance(at(0.60, 0.65), LatentColor(0)), 12);  // on the line between them
  EXPECT_LT(Distance(at(0.35, 0.45), LatentColor(3)), 12);  // from the diagonal up to the point
  EXPECT_GT(Distance(at(0.35, 0.30), LatentColor(3)), 60);
}

TEST(ReliabilityPlotTest, NoTableIsRefused) {
  EXPECT_TRUE(absl::IsInvalidArgument(DrawReliability({}).status()));
}

TEST(LabelPlacerTest, LabelsLieWithinAndApart) {
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
  EXPECT_LT(placed.size(), 40u);  // there is no room for all
  for (size_t i = 0; i < placed.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      EXPECT_TRUE(placed[i].left >= placed[j].right() || placed[j].left >= placed[i].right() ||
                  placed[i].top >= placed[j].bottom() || placed[j].top >= placed[i].bottom());
    }
  }
}

TEST(LabelPlacerTest, NothingIsPlacedOverALine) {
  LabelPlacer placer({0.0, 0.0, 400.0, 400.0});
  placer.Occupy(Line{{0.0, 200.0}, {400.0, 200.0}}, 10.0);
  for (int i = 0; i < 10; ++i) {
    const auto place = placer.Place({200.0, 200.0}, "7", 10.0, 100.0);
    ASSERT_TRUE(place);
    EXPECT_TRUE(place->frame.top >= 205.0 || place->frame.bottom() <= 195.0);
  }
}

TEST(AxesTest, BothAxesHaveTheSameScaleAndHoldTheExtent) {
  const Axes axes({100.0, 50.0, 400.0, 200.0}, {0.0, 20.0, -30.0, 10.0});
  EXPECT_NEAR(axes.pixels_per_meter(), 5.0, 1e-9);  // 40 m on 200 pixels
  EXPECT_NEAR(axes.ToPixel(10.0, -10.0).x, 300.0, 1e-9);
  EXPECT_NEAR(axes.ToPixel(10.0, -10.0).y, 150.0, 1e-9);
  EXPECT_NEAR(axes.ToPixel(0.0, 10.0).y, 50.0, 1e-9);  // left is up
}

TEST(AxesTest, TicksAreRound) {
  EXPECT_EQ(Ticks(-3.0, 12.0, 4), (std::vector<double>{0.0, 5.0, 10.0}));
  EXPECT_EQ(Ticks(0.0, 1.0, 5), (std::vector<double>{0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0}));
  EXPECT_EQ(TickText(0.2, 0.2), "0.2");
  EXPECT_EQ(TickText(-10.0, 5.0), "-10");
}

}  // namespace
}  // namespace maneuver::plot
