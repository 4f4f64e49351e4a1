#include <array>
#include <numbers>

#include "model/data/town/layouts.h"

namespace maneuver::data::town {
namespace {

// Adds driveways along the right kerb: areas across the footway.
void AddDriveways(Place& place, const Road& road, Random& random) {
  const int count = random.Integer(1, 4);
  for (int i = 0; i < count; ++i) {
    const double s = random.Uniform(20.0, road.reference.length() - 26.0);
    if (random.Chance(0.5)) {
      AddArea(place, DecorationKind::kDriveway, road.reference, s, s + 5.0, road.right_edge() - 4.0,
              road.right_edge());
    } else {
      AddArea(place, DecorationKind::kDriveway, road.reference, s, s + 5.0, road.left_edge(),
              road.left_edge() + 4.0);
    }
  }
}

}  // namespace

Place StraightRoad(Random& random) {
  Place place;
  place.layout = "straight_road";
  const double length = 260.0;
  const bool wide = random.Chance(0.7);
  RoadSpec spec;
  spec.forward = wide ? random.Integer(2, 3) : 1;
  spec.backward = spec.forward;
  spec.lane_width = random.Uniform(3.3, 3.7);
  spec.median = wide && random.Chance(0.5) ? random.Uniform(1.5, 4.0) : 0.0;
  spec.speed_limit = wide ? random.Uniform(12.0, 16.5) : random.Uniform(8.0, 13.9);
  spec.bike_lanes = random.Chance(0.5);
  spec.parking = random.Chance(0.4) ? 2.4 : 0.0;
  PathPen pen({.p = {-0.5 * length, 0.0}});
  pen.Straight(length);
  const Road road = AddRoad(place, pen.Done(), spec);
  if (spec.parking > 0.0) {
    ParkAlong(place, road, true, 0.35, random);
    ParkAlong(place, road, false, 0.35, random);
  }
  AddDriveways(place, road, random);
  if (!wide && spec.speed_limit < 10.0) {
    for (const double s : {80.0, 175.0}) {
      AddArea(place, DecorationKind::kSpeedBump, road.reference, s, s + 1.8,
              road.right_edge() + 0.3, road.left_edge() - 0.3);
    }
  }
  place.lane_change_rate = 0.06;
  place.walkers = random.Integer(3, 9);
  place.initial_vehicles = 8 * spec.forward;
  place.sensed_radius = 85.0;
  AddSources(place, random, 4.0, 10.0);
  return place;
}

Place CurvedRoad(Random& random) {
  Place place;
  place.layout = "curved_road";
  RoadSpec spec;
  spec.forward = random.Integer(1, 2);
  spec.backward = spec.forward;
  spec.lane_width = random.Uniform(3.3, 3.6);
  spec.speed_limit = random.Uniform(9.0, 15.5);
  spec.bike_lanes = random.Chance(0.3);
  spec.footways = random.Chance(0.6);
  PathPen pen({.p = {-110.0, 0.0}});
  pen.Straight(random.Uniform(30.0, 55.0));
  double side = random.Chance(0.5) ? 1.0 : -1.0;
  const int bends = random.Integer(2, 3);
  for (int i = 0; i < bends; ++i) {
    const double radius = random.Uniform(28.0, 75.0);
    pen.Turn(side * random.Uniform(0.6, 1.35), radius).Straight(random.Uniform(10.0, 35.0));
    side = -side;
  }
  pen.Straight(40.0);
  // Puts the middle of the curve at the middle of the place.
  const Path drawn = pen.Done();
  const Vec2 middle = drawn.At(0.5 * drawn.length()).p;
  std::vector<PathPoint> points = drawn.points();
  for (PathPoint& point : points) point.p = point.p - middle;
  const Road road = AddRoad(place, Path(points), spec);
  AddDriveways(place, road, random);
  place.lane_change_rate = 0.03;
  place.walkers = spec.footways ? random.Integer(2, 7) : 0;
  place.initial_vehicles = 14;
  place.sensed_radius = 100.0;
  AddSources(place, random, spec.forward == 1 ? 3.0 : 5.0, spec.forward == 1 ? 6.0 : 9.0);
  return place;
}

}  // namespace maneuver::data::town
