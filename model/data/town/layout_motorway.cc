#include <numbers>

#include "model/data/town/layouts.h"

namespace maneuver::data::town {
namespace {

RoadSpec Carriageway(Random& random) {
  RoadSpec spec;
  spec.forward = random.Integer(2, 3);
  spec.backward = random.Chance(0.5) ? spec.forward : 0;
  spec.lane_width = random.Uniform(3.6, 3.8);
  spec.median = spec.backward > 0 ? random.Uniform(3.0, 6.0) : 0.0;
  spec.speed_limit = random.Uniform(22.0, 31.0);
  spec.footways = false;
  spec.no_change_before_end = 20.0;
  return spec;
}

Path GentleCurve(Random& random, double length) {
  const double curvature = random.Chance(0.5) ? random.Uniform(-1.0, 1.0) / 700.0 : 0.0;
  PathPen back({.heading = std::numbers::pi});
  back.Clothoid(0.5 * length, 0.0, -curvature);
  PathPoint start = back.end();
  start.heading += std::numbers::pi;
  PathPen pen(start);
  pen.Clothoid(0.5 * length, curvature, 0.0).Clothoid(0.5 * length, 0.0, curvature);
  return pen.Done();
}

}  // namespace

Place Motorway(Random& random) {
  Place place;
  place.layout = "motorway";
  const RoadSpec spec = Carriageway(random);
  AddRoad(place, GentleCurve(random, 640.0), spec);
  place.walkers = 0;
  place.warm_up = 5.0;
  place.lane_change_rate = 0.09;
  place.long_vehicle_share = 0.12;
  place.initial_vehicles = 7 * (spec.forward + spec.backward) / 2 + 4;
  place.sensed_radius = random.Uniform(150.0, 180.0);
  AddSources(place, random, spec.backward > 0 ? 4.0 : 2.8, spec.backward > 0 ? 7.0 : 6.0);
  return place;
}

Place MotorwayMerge(Random& random) {
  Place place;
  place.layout = "motorway_merge";
  const RoadSpec spec = Carriageway(random);
  const Path reference = GentleCurve(random, 640.0);
  const Road road = AddRoad(place, reference, spec);
  const double outer = -0.5 * spec.median - (spec.forward + 0.5) * spec.lane_width;
  const double begin = random.Uniform(230.0, 270.0);
  const double end = begin + random.Uniform(170.0, 220.0);
  // The ramp comes from the right, bends in, and runs beside the road until it ends.
  const Path beside = reference.Offset(outer).Slice(begin, end);
  Lane acceleration;
  acceleration.path = beside;
  acceleration.width = spec.lane_width;
  acceleration.speed_limit = 0.95 * spec.speed_limit;
  acceleration.left = road.forward.back();
  acceleration.ends = true;
  acceleration.change_from = 5.0;
  acceleration.change_to = beside.length() - 30.0;
  const int accelerate = place.graph.Add(std::move(acceleration));

  PathPoint back = beside.At(0.0);
  back.heading += std::numbers::pi;
  PathPen pen(back);
  pen.Straight(10.0).Turn(random.Uniform(0.35, 0.7), random.Uniform(80.0, 120.0)).Straight(60.0);
  Lane ramp;
  ramp.path = pen.Done().Reversed();
  ramp.width = spec.lane_width;
  ramp.speed_limit = random.Uniform(15.0, 19.0);
  ramp.next = {{.lane = accelerate}};
  const Path ramp_path = ramp.path;
  const int slip = place.graph.Add(std::move(ramp));
  const double half = 0.5 * spec.lane_width + 0.3;
  AddLine(place, DecorationKind::kRoadEdge, ramp_path.Offset(-half));
  AddLine(place, DecorationKind::kRoadEdge,
          ramp_path.Offset(half).Slice(0.0, ramp_path.length() - 25.0));
  AddLine(place, DecorationKind::kRoadEdge, beside.Offset(-half));

  place.walkers = 0;
  place.warm_up = 5.0;
  place.lane_change_rate = 0.05;
  place.long_vehicle_share = 0.08;
  place.initial_vehicles = 5 * (spec.forward + spec.backward) / 2 + 4;
  place.sensed_radius = random.Uniform(140.0, 170.0);
  AddSources(place, random, spec.backward > 0 ? 5.5 : 3.5, spec.backward > 0 ? 9.0 : 6.0);
  for (Source& source : place.sources) {
    if (source.lane == slip) source.mean_headway = random.Uniform(2.5, 4.5);
    if (source.lane == road.forward.back()) source.mean_headway = random.Uniform(7.0, 12.0);
  }
  return place;
}

}  // namespace maneuver::data::town
