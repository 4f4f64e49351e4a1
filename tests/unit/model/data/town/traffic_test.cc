// The physics and the rules of the town's traffic, on noiseless tracks.

#include "model/data/town/traffic.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "gtest/gtest.h"
#include "model/data/town/box_overlap.h"
#include "model/data/town/layouts.h"
#include "model/data/town/maneuvers.h"
#include "tests/unit/model/data/town/simulated_places.h"

namespace maneuver::data::town::traffic_test {
namespace {

constexpr double kFrame = 0.1;  // seconds

template <typename Visit>
void ForEachVehicle(const Visit& visit) {
  for (int index = 0; index < kPlaces; ++index) {
    const SimulatedPlace& simulated = SimulatedPlaces()[index];
    for (const Track& track : simulated.tracks) {
      if (track.kind == RoadUser::kVehicle) visit(simulated.place, track, index);
    }
  }
}

Track Box(int id, double x, double heading) {
  Track track;
  track.id = id;
  track.length = 4.0;
  track.width = 2.0;
  track.points.push_back({.time = 0.0, .p = {x, 0.0}, .heading = heading});
  return track;
}

TEST(TrafficTest, MeasuresTheOverlapOfBoxes) {
  // 4 m long boxes in line, 3.7 m between their centres, overlap by 0.3 m.
  const BoxOverlap overlap = LargestOverlap({Box(1, 0.0, 0.0), Box(2, 3.7, 0.0)});
  EXPECT_NEAR(overlap.depth, 0.3, 1e-9);
  EXPECT_EQ(overlap.first, 1);
  EXPECT_EQ(overlap.second, 2);
  EXPECT_EQ(LargestOverlap({Box(1, 0.0, 0.0), Box(2, 4.1, 0.0)}).depth, 0.0);
  // Crosswise, half a length and half a width count.
  EXPECT_NEAR(LargestOverlap({Box(1, 0.0, 0.0), Box(2, 2.8, 0.5 * std::numbers::pi)}).depth, 0.2,
              1e-9);
}

TEST(TrafficTest, VehiclesDoNotCollide) {
  for (int index = 0; index < kPlaces; ++index) {
    const BoxOverlap overlap = LargestOverlap(SimulatedPlaces()[index].tracks);
    EXPECT_LE(overlap.depth, kOverlapTolerance)
        << "place " << index << ": " << overlap.first << " and " << overlap.second << " at "
        << overlap.time;
  }
}

TEST(TrafficTest, GivingWayKeepsVehiclesApartWithoutDrawingPlacesAgain) {
  int overlapping = 0;
  for (uint64_t index = 0; index < 40; ++index) {
    Random random(11, index, 1);
    const Place place = DrawPlace(random);
    if (LargestOverlap(SimulateTraffic(place, {}, random)).depth > kOverlapTolerance) ++overlapping;
  }
  EXPECT_LE(overlapping, 1);
}

TEST(TrafficTest, NoVehicleHasTheIdOfAPedestrian) {
  Random random(7, 0, 1);
  Place place = DrawPlace(random, {"signal_crossing"});
  ASSERT_FALSE(place.footways.empty());
  place.parked.assign(1100, {});  // take ids first
  int pedestrians = 0;
  for (const Track& track : SimulateTraffic(place, {.duration = 1.0}, random)) {
    for (size_t i = 1; i < track.points.size(); ++i) {
      ASSERT_GT(track.points[i].time, track.points[i - 1].time) << "id " << track.id;
    }
    pedestrians += track.kind == RoadUser::kPedestrian;
  }
  EXPECT_GT(pedestrians, 0);
}

TEST(TrafficTest, VehiclesDoNotRunRedLights) {
  int passed = 0;
  ForEachVehicle([&passed](const Place& place, const Track& track, int index) {
    for (size_t i = 1; i < track.points.size(); ++i) {
      const TrackPoint& now = track.points[i];
      if (now.lane < 0 || now.lane == track.points[i - 1].lane) continue;
      const Lane& lane = place.graph.lanes[now.lane];
      if (!lane.gate || lane.gate->kind != GateKind::kSignal) continue;
      // The front arrived before the centre.
      const double front_passed = track.points[i - 1].travelled - 0.5 * track.length;
      const auto front = std::find_if(
          track.points.begin(), track.points.end(),
          [front_passed](const TrackPoint& point) { return point.travelled >= front_passed; });
      if (front == track.points.begin()) continue;  // before the recording
      EXPECT_NE(place.signals.At(lane.gate->signal_group, front->time), Light::kRed)
          << "place " << index << ", vehicle " << track.id << " at " << front->time;
      ++passed;
    }
  });
  EXPECT_GE(passed, 50);
}

TEST(TrafficTest, VehiclesThatKeepTheLaneStayNearItsCentre) {
  ForEachVehicle([](const Place&, const Track& track, int index) {
    for (const ManeuverInterval& interval : RecordManeuvers(track)) {
      if (interval.maneuver != Maneuver::kKeepLane && interval.maneuver != Maneuver::kCruise) {
        continue;
      }
      for (const TrackPoint& point : track.points) {
        // A lane change that begins in the last second is not recorded.
        if (point.time <= interval.start || point.time >= interval.end - 1.0) continue;
        ASSERT_LT(std::abs(point.lateral), 0.8)
            << "place " << index << ", vehicle " << track.id << " at " << point.time;
      }
    }
  });
}

TEST(TrafficTest, AccelerationsAndYawRatesArePlausible) {
  std::vector<double> accelerations;
  ForEachVehicle([&](const Place&, const Track& track, int index) {
    for (size_t i = 1; i < track.points.size(); ++i) {
      const TrackPoint& a = track.points[i - 1];
      const TrackPoint& b = track.points[i];
      const double acceleration = (b.speed - a.speed) / kFrame;
      const double yaw_rate = (b.heading - a.heading) / kFrame;
      ASSERT_LT(acceleration, 3.5) << "place " << index << ", vehicle " << track.id;
      ASSERT_GT(acceleration, -6.0) << "place " << index << ", vehicle " << track.id;
      ASSERT_LT(std::abs(yaw_rate), 1.2) << "place " << index << ", vehicle " << track.id;
      ASSERT_LT(std::abs(yaw_rate) * b.speed, 5.0) << "place " << index << ", vehicle " << track.id;
      accelerations.push_back(std::abs(acceleration));
    }
  });
  // Hard braking is rare.
  std::sort(accelerations.begin(), accelerations.end());
  EXPECT_LT(accelerations[accelerations.size() * 995 / 1000], 3.5);
}

TEST(TrafficTest, HeadingsFollowTheMotion) {
  int backwards = 0;
  ForEachVehicle([&backwards](const Place& place, const Track& track, int index) {
    for (size_t i = 1; i < track.points.size(); ++i) {
      const TrackPoint& a = track.points[i - 1];
      const TrackPoint& b = track.points[i];
      if (b.speed == 0.0 && a.speed == 0.0) {
        ASSERT_EQ(a.heading, b.heading) << "place " << index << ", vehicle " << track.id;
        ASSERT_EQ(Norm(b.p - a.p), 0.0);
        continue;
      }
      ASSERT_NEAR(Norm(b.p - a.p), 0.5 * (a.speed + b.speed) * kFrame, 0.06)
          << "place " << index << ", vehicle " << track.id << " at " << b.time;
      if (b.speed < 1.0) continue;
      const bool reverse = place.graph.lanes[b.lane].reverse;
      const double slip = WrapAngle(std::atan2(b.velocity.y, b.velocity.x) - b.heading -
                                    (reverse ? std::numbers::pi : 0.0));
      ASSERT_LT(std::abs(slip), 0.4) << "place " << index << ", vehicle " << track.id;
      if (reverse) ++backwards;
    }
  });
  EXPECT_GT(backwards, 20);  // out of bays
}

TEST(TrafficTest, SpeedsSuitThePlace) {
  double fastest_car_park = 0.0;
  double motorway = 0.0;
  int motorway_points = 0;
  ForEachVehicle([&](const Place& place, const Track& track, int) {
    for (const TrackPoint& point : track.points) {
      if (place.layout == "car_park") fastest_car_park = std::max(fastest_car_park, point.speed);
      if (place.layout == "motorway" || place.layout == "motorway_merge") {
        motorway += point.speed;
        ++motorway_points;
      }
    }
  });
  EXPECT_LT(fastest_car_park, 7.0);
  ASSERT_GT(motorway_points, 0);
  EXPECT_GT(motorway / motorway_points, 18.0);
  EXPECT_LT(motorway / motorway_points, 33.0);
}

}  // namespace
}  // namespace maneuver::data::town::traffic_test
