// Compares long lines of many points, some of which the rasterizer skips, with the distance to each
// of their segments.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::rasterizer_lines_test {
namespace {

// Projects as the rasterizer's header says, directly by X_WT^-1.
Point2 InPicture(const v1::RasterSpec& spec, const Pose2& X_WT, double x, double y) {
  const double dx = x - X_WT.x();
  const double dy = y - X_WT.y();
  const double c = std::cos(X_WT.heading());
  const double s = std::sin(X_WT.heading());
  return {spec.target_position() * spec.width() + (c * dx + s * dy) / spec.meters_per_pixel(),
          0.5 * spec.height() - (c * dy - s * dx) / spec.meters_per_pixel()};
}

double Distance(const Point2& p, const Point2& a, const Point2& b) {
  const double dx = b.x - a.x;
  const double dy = b.y - a.y;
  const double t = std::clamp(
      ((p.x - a.x) * dx + (p.y - a.y) * dy) / std::max(dx * dx + dy * dy, 1e-30), 0.0, 1.0);
  return std::hypot(p.x - a.x - t * dx, p.y - a.y - t * dy);
}

class LineOfManyPointsTest : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(EverySeed, LineOfManyPointsTest, testing::Range(0, 12));

TEST_P(LineOfManyPointsTest, IsDrawnInTheRightPlace) {
  // Points within 0.05 pixels may be skipped; rounding adds half a level.
  constexpr double kTolerance = 0.05 * 255.0 + 1.0;
  std::mt19937_64 random(GetParam());
  const auto uniform = [&random](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  v1::RasterSpec spec = SmallSpec();
  spec.set_width(48);
  spec.set_height(40);
  spec.set_meters_per_pixel(1.6);
  spec.set_target_position(0.3);
  const Pose2 X_WT(uniform(-500, 500), uniform(-500, 500), uniform(-3, 3));
  v1::Scenario scenario;
  // Straight for a while, then around a bend; out of the picture and back into it.
  v1::MapFeature* lane = AddFeature(&scenario, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {});
  Point2 place = X_WT * Point2{uniform(-20, 40), uniform(-20, 20)};
  double heading = uniform(-3, 3);
  double curvature = 0.0;
  for (int i = 0; i < 900; ++i) {
    if (i % 40 == 0) curvature = random() % 2 == 0 ? 0.0 : uniform(-0.15, 0.15);
    lane->add_x(place.x);
    lane->add_y(place.y);
    const double step = uniform(0.1, 0.9);
    heading += curvature * step;
    place = {place.x + step * std::cos(heading), place.y + step * std::sin(heading)};
  }
  const Picture raster = Draw(spec, scenario, 0.0, 1, X_WT);
  std::vector<Point2> points;
  for (int i = 0; i < lane->x_size(); ++i) {
    points.push_back(InPicture(spec, X_WT, lane->x(i), lane->y(i)));
  }
  int nonzero = 0;
  for (int row = 0; row < spec.height(); ++row) {
    for (int column = 0; column < spec.width(); ++column) {
      double nearest = HUGE_VAL;
      for (size_t i = 1; i < points.size(); ++i) {
        nearest = std::min(nearest, Distance({column + 0.5, row + 0.5}, points[i - 1], points[i]));
      }
      ASSERT_NEAR(raster.at(row, column, kLaneChannel), 255.0 * std::max(0.0, 1.0 - nearest),
                  kTolerance)
          << "row " << row << " column " << column;
      nonzero += nearest < 1.0;
    }
  }
  EXPECT_GT(nonzero, 20);
}

}  // namespace
}  // namespace maneuver::scene::rasterizer_lines_test
