// The figures of an evaluation.

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <tuple>

#include "client/plot/action_means_plot.h"
#include "client/plot/canvas.h"
#include "client/plot/posterior_plot.h"
#include "client/plot/reliability_plot.h"
#include "tests/unit/client/pictures_for_tests.h"

namespace maneuver::plot::evaluation_plots_test {
namespace {

// Returns one action as in Answer, whose sigma trajectories end `spread` metres to each side.
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

TEST(PosteriorPlotTest, DrawsGenericLeftAndPosteriorRightAtTheSameScale) {
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
  // The outermost sigma trajectory 30 m ahead, drawn thin.
  const Color color = ActionColor(2);
  const double outermost = -0.2 * 30.0 - 10.0 * 0.75;
  EXPECT_LT(left_frame.NearestDistance(left, 30.0, outermost, color), 150);
  EXPECT_GT(right_frame.NearestDistance(right, 30.0, outermost, color), 180);
  for (const double ahead : {15.0, 25.0, 35.0}) {  // mean and truth have not moved
    EXPECT_LT(left_frame.NearestDistance(left, ahead, -0.2 * ahead, color), 12);
    EXPECT_LT(right_frame.NearestDistance(right, ahead, -0.2 * ahead, color), 12);
    EXPECT_LT(right_frame.NearestDistance(right, ahead, 0.2 * ahead, kWhite), 12);
  }
}

TEST(PosteriorPlotTest, RefusesTargetsWithoutTwoValidAnswers) {
  v1::ScenarioPrediction other = Answer(0.9);
  other.mutable_targets(0)->set_target_id(8);
  EXPECT_TRUE(absl::IsInvalidArgument(
      DrawGenericAndPosterior(Scene(), Answer(0.9), other, Options()).status()));
  v1::ScenarioPrediction uneven = Answer(0.9);
  uneven.mutable_targets(0)->mutable_distributions(0)->mutable_mean_trajectory()->add_x(1.0);
  EXPECT_TRUE(absl::IsInvalidArgument(
      DrawGenericAndPosterior(Scene(), Answer(0.9), uneven, Options()).status()));
}

// Returns a report of two actions: two examples, both most likely the first action.
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

TEST(ActionMeansPlotTest, DrawsTrajectoriesInTheColourOfTheirAction) {
  // The most frequent action gets the first colour, the other one the next.
  const Color first = LatentColor(0);
  const Color second = LatentColor(1);
  const auto blend = [](Color c) {  // a thin line on white
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

TEST(ActionMeansPlotTest, LeavesOutUnusedActions) {
  v1::ActionSet set = TwoMeans();
  set.mutable_actions(1)->set_effective(false);
  const cv::Mat picture = Decode(*DrawActionMeans(set, Report()));
  EXPECT_LT(Count(picture, LatentColor(1), 10), 50);
}

TEST(ActionMeansPlotTest, ALongNameStaysWithinTheLegend) {
  v1::ActionSet set = TwoMeans();
  set.mutable_actions(0)->set_display_name(std::string(64, 'e'));  // as long as a label may be
  const cv::Mat picture = Decode(*DrawActionMeans(set, Report()));
  const cv::Mat margin = picture.colRange(picture.cols - 30, picture.cols);  // right of the legend
  const cv::Mat blank(margin.rows, margin.cols, margin.type(), cv::Scalar::all(255));
  EXPECT_EQ(cv::norm(margin, blank, cv::NORM_INF), 0.0);
}

TEST(ActionMeansPlotTest, RefusesWhatItCannotDraw) {
  EXPECT_TRUE(absl::IsInvalidArgument(DrawActionMeans({}, Report()).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(DrawActionMeans(TwoMeans(), {}).status()));
  v1::EvaluationReport uneven = Report();
  uneven.mutable_sampled_examples(0)->mutable_trajectory()->add_x(1.0);
  EXPECT_TRUE(absl::IsInvalidArgument(DrawActionMeans(TwoMeans(), uneven).status()));
}

TEST(ReliabilityPlotTest, DrawsPointsWhereTheTableSays) {
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

TEST(ReliabilityPlotTest, RefusesAReportWithoutATable) {
  EXPECT_TRUE(absl::IsInvalidArgument(DrawReliability({}).status()));
}

}  // namespace
}  // namespace maneuver::plot::evaluation_plots_test
