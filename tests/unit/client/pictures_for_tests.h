// A scene with one action, and how to read its picture.

#ifndef MANEUVER_TESTS_UNIT_CLIENT_PICTURES_FOR_TESTS_H_
#define MANEUVER_TESTS_UNIT_CLIENT_PICTURES_FOR_TESTS_H_

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "client/plot/canvas.h"
#include "client/plot/scene_plot.h"

namespace maneuver::plot {

inline cv::Mat Decode(const std::string& png) {
  const std::vector<uint8_t> bytes(png.begin(), png.end());
  return cv::imdecode(bytes, cv::IMREAD_COLOR);
}

// Returns how far a pixel's colour is from `color`, in the channel where it is furthest.
inline int Distance(const cv::Vec3b& bgr, Color color) {
  return std::max({std::abs(bgr[2] - color.red), std::abs(bgr[1] - color.green),
                   std::abs(bgr[0] - color.blue)});
}

inline constexpr double kHeading = 0.5;

// A long vehicle at (100, 50) with a heading of half a radian, which then drives straight from (0,
// 0) to (40, 8) of its frame in 5 s.
inline v1::Scenario Scene() {
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
inline v1::ScenarioPrediction Answer(double probability) {
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

inline ScenePlotOptions Options() {
  ScenePlotOptions options;
  options.width = 900;
  options.height = 600;
  options.frame = v1::FRAME_TARGET;
  return options;
}

// Finds where the points of the target's frame lie in a picture, from the picture itself: the
// target's box, 10 m by 4 m about the origin, is the only large patch of its yellow.
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

  // Returns the smallest Distance from `color` among the pixels within two of where (ahead, left)
  // lies.
  //   ahead, left: metres
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

inline constexpr Color kWhite = {255, 255, 255};

}  // namespace maneuver::plot

#endif  // MANEUVER_TESTS_UNIT_CLIENT_PICTURES_FOR_TESTS_H_
