// The recorded manoeuvres of hand-made tracks.

#include "model/data/town/maneuvers.h"

#include <functional>
#include <string>

#include "gtest/gtest.h"

namespace maneuver::data::town::maneuvers_test {
namespace {

// Returns a track along x for `seconds`, with speed and turn rate given as functions of time.
Track Drive(
    double seconds, const std::function<double(double)>& speed,
    const std::function<double(double)>& yaw_rate = [](double) { return 0.0; }) {
  Track track;
  double travelled = 0.0;
  double heading = 0.0;
  Vec2 p;
  for (int i = 0; i * 0.1 <= seconds + 1e-9; ++i) {
    const double t = 0.1 * i;
    track.points.push_back({.time = t,
                            .p = p,
                            .heading = heading,
                            .velocity = speed(t) * Direction(heading),
                            .speed = speed(t),
                            .travelled = travelled});
    travelled += 0.1 * speed(t);
    p = p + 0.1 * speed(t) * Direction(heading);
    heading += 0.1 * yaw_rate(t);
  }
  return track;
}

std::string Names(const Track& track) {
  std::string names;
  for (const ManeuverInterval& interval : RecordManeuvers(track)) {
    names += (names.empty() ? "" : " ") + std::string(ManeuverName(interval.maneuver));
  }
  return names;
}

TEST(ManeuversTest, LabelsStraightDrivingBySpeed) {
  EXPECT_EQ(Names(Drive(8.0, [](double) { return 3.0; })), "creep");
  EXPECT_EQ(Names(Drive(8.0, [](double) { return 12.0; })), "keep_lane");
  EXPECT_EQ(Names(Drive(8.0, [](double) { return 27.0; })), "cruise");
  EXPECT_EQ(Names(Drive(8.0, [](double) { return 0.0; })), "standing");
}

TEST(ManeuversTest, LabelsBendsByTheirDirection) {
  EXPECT_EQ(Names(Drive(
                8.0, [](double) { return 10.0; }, [](double) { return 0.2; })),
            "follow_curve_left");
  EXPECT_EQ(Names(Drive(
                8.0, [](double) { return 10.0; }, [](double) { return -0.2; })),
            "follow_curve_right");
}

TEST(ManeuversTest, LabelsStopsStandstillsAndStarts) {
  const auto speed = [](double t) {
    if (t < 4.0) return 10.0;
    if (t < 8.0) return 10.0 - 2.5 * (t - 4.0);
    if (t < 11.0) return 0.0;
    return std::min(10.0, 2.0 * (t - 11.0));
  };
  const Track track = Drive(20.0, speed);
  EXPECT_EQ(Names(track), "keep_lane stop standing start keep_lane");
  const auto intervals = RecordManeuvers(track);
  EXPECT_NEAR(intervals[2].start, 7.8, 0.25);
  EXPECT_NEAR(intervals[3].start, 11.3, 0.25);
}

TEST(ManeuversTest, StandingPrecedesRouteEventsWhichPrecedeTheRest) {
  const auto speed = [](double t) { return t > 4.0 && t < 7.0 ? 0.0 : 5.0; };
  Track track = Drive(14.0, speed);
  track.events.push_back({Maneuver::kTurnLeft, 10.0, 10.0, 45.0});
  EXPECT_EQ(Names(track), "stop turn_left standing turn_left creep");
}

TEST(ManeuversTest, IntervalsFollowEachOtherWithoutAGap) {
  Track track = Drive(14.0, [](double t) { return t < 6.0 ? 12.0 - 2.0 * t : 0.0; });
  const auto intervals = RecordManeuvers(track);
  EXPECT_DOUBLE_EQ(intervals.front().start, 0.0);
  EXPECT_DOUBLE_EQ(intervals.back().end, track.points.back().time);
  for (size_t i = 1; i < intervals.size(); ++i) {
    EXPECT_DOUBLE_EQ(intervals[i].start, intervals[i - 1].end);
  }
}

}  // namespace
}  // namespace maneuver::data::town::maneuvers_test
