// Compares the manoeuvres that the town records with what its vehicles do.

#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <string>

#include "gtest/gtest.h"
#include "model/data/town/maneuvers.h"
#include "tests/unit/model/data/town/simulated_places.h"

namespace maneuver::data::town::recorded_maneuvers_test {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

const TrackPoint& PointAt(const Track& track, double time) {
  for (const TrackPoint& point : track.points) {
    if (point.time >= time - 1e-6) return point;
  }
  return track.points.back();
}

// Calls visit(track, before, interval, after) for each interval with one before and one after it.
template <typename Visit>
void ForEachWholeInterval(const Visit& visit) {
  for (const SimulatedPlace& simulated : SimulatedPlaces()) {
    for (const Track& track : simulated.tracks) {
      if (track.kind != RoadUser::kVehicle) continue;
      const std::vector<ManeuverInterval> intervals = RecordManeuvers(track);
      for (size_t i = 1; i + 1 < intervals.size(); ++i) {
        visit(track, intervals[i - 1], intervals[i], intervals[i + 1]);
      }
    }
  }
}

double Turned(const Track& track, const ManeuverInterval& interval) {
  return PointAt(track, interval.end).heading - PointAt(track, interval.start).heading;
}

TEST(RecordedManeuversTest, EveryManeuverOccurs) {
  std::set<Maneuver> seen;
  for (const SimulatedPlace& simulated : SimulatedPlaces()) {
    for (const Track& track : simulated.tracks) {
      if (track.kind != RoadUser::kVehicle) continue;
      for (const ManeuverInterval& interval : RecordManeuvers(track))
        seen.insert(interval.maneuver);
    }
  }
  for (int i = 0; i < kManeuverCount; ++i) {
    EXPECT_TRUE(seen.contains(static_cast<Maneuver>(i))) << ManeuverName(static_cast<Maneuver>(i));
  }
}

TEST(RecordedManeuversTest, TurnsTurnInTheNamedDirection) {
  std::map<Maneuver, int> count;
  ForEachWholeInterval([&count](const Track& track, const ManeuverInterval& before,
                                const ManeuverInterval& interval, const ManeuverInterval& after) {
    // An interrupted turn is recorded in pieces.
    if (before.maneuver == Maneuver::kStanding && before.end > 0.0) return;
    if (after.maneuver == Maneuver::kStanding || after.maneuver == Maneuver::kStop) return;
    const double degrees = Turned(track, interval) / kDegree;
    switch (interval.maneuver) {
      case Maneuver::kTurnLeft:
        EXPECT_GT(degrees, 45.0) << track.id;
        EXPECT_LT(degrees, 135.0) << track.id;
        break;
      case Maneuver::kTurnRight:
        EXPECT_LT(degrees, -45.0) << track.id;
        EXPECT_GT(degrees, -135.0) << track.id;
        break;
      case Maneuver::kUTurn:
        EXPECT_NEAR(degrees, 180.0, 35.0) << track.id;
        break;
      default:
        return;
    }
    ++count[interval.maneuver];
  });
  EXPECT_GE(count[Maneuver::kTurnLeft], 10);
  EXPECT_GE(count[Maneuver::kTurnRight], 10);
  EXPECT_GE(count[Maneuver::kUTurn], 3);
}

TEST(RecordedManeuversTest, LaneChangesMoveInTheNamedDirection) {
  int count = 0;
  ForEachWholeInterval([&count](const Track& track, const ManeuverInterval& before,
                                const ManeuverInterval& interval, const ManeuverInterval& after) {
    const bool left =
        interval.maneuver == Maneuver::kLaneChangeLeft || interval.maneuver == Maneuver::kMerge;
    if (!left && interval.maneuver != Maneuver::kLaneChangeRight) return;
    // A lane change that a queue interrupts is recorded in pieces.
    for (const ManeuverInterval& beside : {before, after}) {
      if (beside.maneuver == Maneuver::kStanding || beside.maneuver == Maneuver::kStop) return;
    }
    // In its first frame, the offset is still measured from the old lane.
    const double moved =
        PointAt(track, interval.end).lateral - PointAt(track, interval.start + 0.1).lateral;
    EXPECT_GT(left ? moved : -moved, 1.5) << track.id << " at " << interval.start;
    ++count;
  });
  EXPECT_GE(count, 20);
}

TEST(RecordedManeuversTest, StopsEndAndStartsBeginAtAStandstill) {
  int stops = 0;
  int starts = 0;
  ForEachWholeInterval([&](const Track& track, const ManeuverInterval& before,
                           const ManeuverInterval& interval, const ManeuverInterval&) {
    const double from = PointAt(track, interval.start).speed;
    const double to = PointAt(track, interval.end).speed;
    if (interval.maneuver == Maneuver::kStop) {
      EXPECT_LT(to, from + 0.1) << track.id << " at " << interval.start;
      ++stops;
    }
    if (interval.maneuver == Maneuver::kStart && before.maneuver == Maneuver::kStanding) {
      EXPECT_LT(from, 1.0) << track.id << " at " << interval.start;
      EXPECT_GT(to, from) << track.id << " at " << interval.start;
      ++starts;
    }
  });
  EXPECT_GE(stops, 50);
  EXPECT_GE(starts, 30);
}

TEST(RecordedManeuversTest, StandingVehiclesStandStill) {
  ForEachWholeInterval([](const Track& track, const ManeuverInterval&,
                          const ManeuverInterval& interval, const ManeuverInterval&) {
    if (interval.maneuver != Maneuver::kStanding) return;
    const double way = Norm(PointAt(track, interval.end).p - PointAt(track, interval.start).p);
    EXPECT_LT(way, 1.5) << track.id << " at " << interval.start;
  });
}

TEST(RecordedManeuversTest, NoManeuverTakesMostOfTheMovingTime) {
  std::map<Maneuver, double> seconds;
  double all = 0.0;
  double moving = 0.0;
  for (const SimulatedPlace& simulated : SimulatedPlaces()) {
    for (const Track& track : simulated.tracks) {
      if (track.kind != RoadUser::kVehicle) continue;
      for (const ManeuverInterval& interval : RecordManeuvers(track)) {
        const double length = interval.end - interval.start;
        all += length;
        if (interval.maneuver == Maneuver::kStanding) continue;
        seconds[interval.maneuver] += length;
        moving += length;
      }
    }
  }
  EXPECT_GT(moving / all, 0.4);
  EXPECT_LT(moving / all, 0.85);
  for (const auto& [maneuver, length] : seconds) {
    EXPECT_LT(length / moving, 0.5) << ManeuverName(maneuver);
  }
  const double turning = seconds[Maneuver::kTurnLeft] + seconds[Maneuver::kTurnRight] +
                         seconds[Maneuver::kUTurn] + seconds[Maneuver::kRoundabout];
  EXPECT_GT(turning / moving, 0.06);
}

}  // namespace
}  // namespace maneuver::data::town::recorded_maneuvers_test
