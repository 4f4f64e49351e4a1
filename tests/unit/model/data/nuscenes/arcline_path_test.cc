#include "model/data/nuscenes/arcline_path.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

namespace maneuver::data::arcline_path_test {
namespace {

using scene::Point2;
using scene::Pose2;

ArclinePath Path(const std::string& shape, double radius, const std::array<double, 3>& lengths) {
  const auto curvatures = CurvaturesOf(shape, radius);
  EXPECT_TRUE(curvatures.ok()) << curvatures.status();
  return {.start = {12.0, -7.0, 2.5}, .curvatures = *curvatures, .lengths = lengths};
}

// Follows the definition of a path by small steps: x' = cos h, y' = sin h, h' = k, by the classical
// Runge-Kutta method. Knows no arcs.
Pose2 Integrated(const std::string& shape, double radius, const std::array<double, 3>& lengths,
                 double distance) {
  double x = 12.0, y = -7.0, h = 2.5;
  for (size_t i = 0; i < 3; ++i) {
    const double within = std::min(distance, lengths[i]);
    distance -= within;
    const double k = shape[i] == 'L' ? 1.0 / radius : shape[i] == 'R' ? -1.0 / radius : 0.0;
    constexpr int kSteps = 400;
    const double step = within / kSteps;
    for (int n = 0; n < kSteps; ++n) {
      const double middle = h + 0.5 * step * k, end = h + step * k;
      x += step / 6.0 * (std::cos(h) + 4.0 * std::cos(middle) + std::cos(end));
      y += step / 6.0 * (std::sin(h) + 4.0 * std::sin(middle) + std::sin(end));
      h = end;
    }
  }
  return {x, y, h};
}

TEST(ArclinePathTest, EveryShapeIsTheIntegralOfItsCurvature) {
  const std::array<double, 3> lengths = {9.0, 14.0, 6.5};
  for (const std::string shape : {"LSL", "LSR", "RSL", "RSR", "LRL", "RLR"}) {
    for (const double radius : {4.0, 13.7, 999.999}) {
      const ArclinePath path = Path(shape, radius, lengths);
      for (const double distance : {0.0, 3.0, 9.0, 9.5, 20.0, 23.0, 26.0, 29.5}) {
        const Pose2 expected = Integrated(shape, radius, lengths, distance);
        const Pose2 pose = path.PoseAt(distance);
        EXPECT_NEAR(pose.x(), expected.x(), 1e-8) << shape << " " << radius << " " << distance;
        EXPECT_NEAR(pose.y(), expected.y(), 1e-8) << shape << " " << radius << " " << distance;
        EXPECT_NEAR(pose.heading(), expected.heading(), 1e-12);
      }
    }
  }
}

TEST(ArclinePathTest, AQuarterOfACircleEndsBesideItsCentre) {
  ArclinePath path = Path("LSL", 10.0, {5.0 * std::numbers::pi, 0.0, 0.0});
  path.start = {0.0, 0.0, 0.0};
  const Pose2 end = path.PoseAt(path.length());
  EXPECT_NEAR(end.x(), 10.0, 1e-12);
  EXPECT_NEAR(end.y(), 10.0, 1e-12);
  EXPECT_NEAR(end.heading(), 0.5 * std::numbers::pi, 1e-12);
}

TEST(ArclinePathTest, PointsAreEvenlySpacedAndJoinTheNextPath) {
  const ArclinePath path = Path("LSR", 8.0, {3.3, 4.4, 2.7});  // 10.4 m
  std::vector<Point2> points;
  AppendPoints(path, 1.0, &points);
  ASSERT_EQ(points.size(), 12u);
  for (size_t i = 0; i < points.size(); ++i) {
    const Pose2 pose = path.PoseAt(10.4 * static_cast<double>(i) / 11.0);
    EXPECT_NEAR(points[i].x, pose.x(), 1e-9);
    EXPECT_NEAR(points[i].y, pose.y(), 1e-9);
  }
  ArclinePath next = path;
  next.start = path.PoseAt(path.length());
  AppendPoints(next, 1.0, &points);
  EXPECT_EQ(points.size(), 23u);  // the point where they meet is there once
}

TEST(ArclinePathTest, APathWithoutLengthIsItsTwoEnds) {
  std::vector<Point2> points;
  AppendPoints(Path("RSR", 5.0, {0.0, 0.0, 0.0}), 1.0, &points);
  EXPECT_EQ(points.size(), 2u);
}

TEST(ArclinePathTest, RefusesUnknownShapesAndRadii) {
  for (const char* shape : {"", "LS", "SSS", "LSLL", "lsl", "LLL"}) {
    EXPECT_FALSE(CurvaturesOf(shape, 5.0).ok()) << shape;
  }
  for (const double radius : {0.0, -1.0, std::nan("")}) {
    EXPECT_FALSE(CurvaturesOf("LSL", radius).ok()) << radius;
  }
}

}  // namespace
}  // namespace maneuver::data::arcline_path_test
