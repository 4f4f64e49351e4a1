#include "model/data/town/path.h"

#include <cmath>
#include <numbers>

#include "gtest/gtest.h"

namespace maneuver::data::town::path_test {
namespace {

constexpr double kPi = std::numbers::pi;

Path Arc(double radius, double angle) {
  return PathPen(PathPoint{}).Clothoid(radius * angle, 1.0 / radius, 1.0 / radius).Done();
}

TEST(PathTest, MeasuresArcLengthOnACircle) {
  const Path arc = Arc(20.0, 0.5 * kPi);
  EXPECT_NEAR(arc.length(), 10.0 * kPi, 1e-2);
  const PathPoint middle = arc.At(5.0 * kPi);
  EXPECT_NEAR(middle.p.x, 20.0 * std::sin(0.25 * kPi), 1e-2);
  EXPECT_NEAR(middle.p.y, 20.0 * (1.0 - std::cos(0.25 * kPi)), 1e-2);
  EXPECT_NEAR(middle.heading, 0.25 * kPi, 1e-3);
}

TEST(PathTest, OffsetOfAnArcIsAnArcAboutTheSameCentre) {
  const Path inner = Arc(20.0, 0.5 * kPi).Offset(4.0);
  EXPECT_NEAR(inner.length(), 8.0 * kPi, 1e-2);
  for (double s = 1.0; s <= inner.length() - 1.0; s += 1.0) {
    EXPECT_NEAR(Norm(inner.At(s).p - Vec2{0.0, 20.0}), 16.0, 1e-2);
    EXPECT_NEAR(inner.At(s).curvature, 1.0 / 16.0, 1e-4);
  }
}

TEST(PathTest, HeadingIsTheDirectionOfMotion) {
  const Path turn = PathPen(PathPoint{}).Straight(5.0).Turn(-1.2, 9.0).Straight(5.0).Done();
  for (double s = 0.5; s < turn.length() - 0.5; s += 0.7) {
    const Vec2 d = turn.At(s + 0.25).p - turn.At(s - 0.25).p;
    EXPECT_NEAR(WrapAngle(std::atan2(d.y, d.x) - turn.At(s).heading), 0.0, 5e-3) << s;
  }
}

TEST(PathTest, ATurnHasItsAngleAndIsNoTighterThanItsRadius) {
  const PathPen pen = PathPen(PathPoint{}).Turn(1.3, 8.0);
  EXPECT_NEAR(pen.end().heading, 1.3, 1e-9);
  for (const PathPoint& point : pen.points()) EXPECT_LE(point.curvature, 1.0 / 8.0 + 1e-12);
  EXPECT_NEAR(pen.end().curvature, 0.0, 1e-12);
}

TEST(PathTest, ConnectingPathsMeetBothPosesExactly) {
  for (const double angle : {-1.9, -1.57, -0.4, 0.0, 0.3, 1.2, 1.57, 2.0}) {
    const PathPoint from{.p = {3.0, -2.0}, .heading = 0.3};
    const PathPoint to{.p = from.p + 14.0 * Direction(0.3) + 13.0 * Direction(0.3 + angle),
                       .heading = 0.3 + angle};
    const Path path = ConnectPoses(from, to);
    EXPECT_NEAR(Norm(path.At(0.0).p - from.p), 0.0, 1e-6) << angle;
    EXPECT_NEAR(Norm(path.At(path.length()).p - to.p), 0.0, 1e-6) << angle;
    EXPECT_NEAR(WrapAngle(path.At(path.length()).heading - to.heading), 0.0, 1e-6) << angle;
  }
}

TEST(PathTest, AUTurnEndsAtItsPoseFacingBack) {
  const PathPoint from{.p = {1.0, 2.0}, .heading = 0.0};
  const PathPoint to{.p = {1.0, 14.0}, .heading = kPi};
  const Path path = UTurnPath(from, to);
  EXPECT_NEAR(Norm(path.At(path.length()).p - to.p), 0.0, 0.05);
  EXPECT_NEAR(WrapAngle(path.At(path.length()).heading - kPi), 0.0, 1e-6);
}

TEST(PathTest, ProjectsToTheNearestPoint) {
  const Path path = PathPen(PathPoint{}).Straight(10.0).Turn(1.0, 30.0).Straight(10.0).Done();
  const Vec2 p = path.At(23.0).p + 2.5 * Left(Direction(path.At(23.0).heading));
  EXPECT_NEAR(path.Project(p, 15.0), 23.0, 0.02);
}

}  // namespace
}  // namespace maneuver::data::town::path_test
