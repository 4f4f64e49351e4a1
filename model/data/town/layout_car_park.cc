// Aisles between rows of bays. Vehicles arrive and leave along the aisles. Some pull out of their
// bays: backwards and then forwards, or, if they parked backwards, forwards only.

#include <cmath>
#include <numbers>
#include <vector>

#include "model/data/town/layouts.h"

namespace maneuver::data::town {
namespace {

constexpr double kBayWidth = 2.8;  // metres
constexpr double kBayDepth = 5.2;

// Adds the lane that leads out of a bay at `s` along an aisle, onto the aisle's far lane. Returns
// -1 if the aisle is too short for it.
int AddWayOut(Place& place, const Road& aisle, double s, bool right, bool nose_in,
              const PathPoint& bay) {
  const int far = right ? aisle.backward[0] : aisle.forward[0];
  const Path& path = place.graph.lanes[far].path;
  PathPoint out = bay;
  if (nose_in) out.heading += std::numbers::pi;
  const double beside = path.Project(bay.p, right ? path.length() - s : s);
  const double reach = std::abs(Dot(path.At(beside).p - bay.p, Direction(out.heading)));
  const double along = reach - 2.6;
  Lane lane;
  lane.kind = LaneKind::kBay;
  lane.movement = Movement::kParkOut;
  lane.reverse = nose_in;
  lane.speed_limit = 2.8;
  lane.gate = Gate{.kind = GateKind::kYield};
  const double joins = nose_in ? beside - along : beside + along;
  if (joins < 6.0 || joins > path.length() - 12.0) return -1;
  PathPoint end = path.At(joins);
  if (nose_in) end.heading += std::numbers::pi;
  lane.path = ConnectPoses(out, end);
  lane.next = {{.lane = far, .at = joins}};
  return place.graph.Add(std::move(lane));
}

void AddBays(Place& place, const Road& aisle, bool right, double from, double share,
             double leaving_share, Random& random) {
  const double edge = right ? aisle.right_edge() : aisle.left_edge();
  const double inwards = right ? 1.0 : -1.0;
  const double to = aisle.reference.length() - 14.0;
  // The kerb runs around the row and then continues along the aisle.
  const double back = edge - inwards * kBayDepth;
  const double row_end = from + kBayWidth * std::floor((to - from) / kBayWidth);
  AddLine(place, DecorationKind::kRoadEdge, aisle.reference.Offset(back).Slice(from, row_end));
  AddLine(place, DecorationKind::kRoadEdge, aisle.reference.Offset(edge).Slice(0.0, from));
  AddLine(place, DecorationKind::kRoadEdge,
          aisle.reference.Offset(edge).Slice(row_end, aisle.reference.length()));
  bool beside_leaver = false;
  for (double s = from; s + kBayWidth < to + 1e-9; s += kBayWidth) {
    const PathPoint at = aisle.reference.At(s + 0.5 * kBayWidth);
    const Vec2 left = Left(Direction(at.heading));
    for (const double side : {s, s + kBayWidth}) {
      const PathPoint line = aisle.reference.At(side);
      place.decorations.push_back(
          {DecorationKind::kRoadLine,
           {line.p + edge * left, line.p + (edge - inwards * kBayDepth) * left}});
    }
    if (!random.Chance(share)) {
      beside_leaver = false;
      continue;
    }
    const bool nose_in = random.Chance(0.65);
    const double depth = 0.5 * kBayDepth + random.Normal(0.0, 0.12);
    PathPoint pose{.p = at.p + (edge - inwards * depth) * left};
    const double outwards = at.heading + (right ? -kQuarter : kQuarter);
    pose.heading = outwards + (nose_in ? 0.0 : std::numbers::pi);
    ParkedVehicle parked{.pose = pose,
                         .length = random.ClampedNormal(4.5, 0.25, 3.8, 4.9),
                         .width = random.ClampedNormal(1.82, 0.06, 1.65, 1.95)};
    if (!beside_leaver && random.Chance(leaving_share)) {
      parked.bay_lane = AddWayOut(place, aisle, s + 0.5 * kBayWidth, right, nose_in, pose);
      parked.leaves_after = random.Uniform(-6.0, 14.0);
      beside_leaver = parked.bay_lane >= 0;
    } else {
      beside_leaver = false;
    }
    if (parked.bay_lane < 0) parked.pose.heading += random.Normal(0.0, 0.02);
    place.parked.push_back(parked);
  }
}

}  // namespace

Place CarPark(Random& random) {
  Place place;
  place.layout = "car_park";
  RoadSpec aisle;
  aisle.lane_width = random.Uniform(3.2, 3.5);
  aisle.speed_limit = random.Uniform(3.8, 5.6);
  aisle.footways = false;
  aisle.painted = false;
  aisle.kerbs = false;
  const int count = random.Chance(0.5) ? 3 : 4;
  std::vector<Arm> arms(count);
  for (int i = 0; i < count; ++i) {
    arms[i].heading = i * kQuarter;
    arms[i].spec = aisle;
    arms[i].length = i % 2 == 0 ? random.Uniform(62.0, 75.0) : random.Uniform(50.0, 60.0);
    arms[i].major = i % 2 == 0;
  }
  JunctionSpec spec;
  spec.control = Control::kYield;
  spec.crosswalks = false;
  spec.corner = random.Uniform(4.0, 5.5);
  spec.left_weight = 1.5;
  spec.right_weight = 1.5;
  const std::vector<Road> roads = AddJunction(place, arms, spec);
  const double leaving = random.Uniform(0.25, 0.45);
  for (int i = 0; i < count; ++i) {
    const double share = random.Uniform(0.2, 0.45);
    // Rows of different aisles must not overlap.
    const double from = i % 2 == 0 ? 4.0 : 12.0;
    AddBays(place, roads[i], true, from, share, leaving, random);
    AddBays(place, roads[i], false, from, share, leaving, random);
    AddArea(place, DecorationKind::kSpeedBump, roads[i].reference, 30.0, 31.0,
            roads[i].right_edge() + 0.3, roads[i].left_edge() - 0.3);
    // People walk along the aisles, to and from their cars.
    AddFootway(place, roads[i].reference.Offset(roads[i].right_edge() + 0.3), 1.0);
  }
  const Road& entrance = roads[0];
  const double end = entrance.reference.length();
  AddArea(place, DecorationKind::kDriveway, entrance.reference, end - 8.0, end,
          entrance.right_edge(), entrance.left_edge());
  place.walkers = random.Integer(2, 6);
  place.initial_vehicles = random.Integer(3, 5);
  place.sensed_radius = random.Uniform(55.0, 65.0);
  AddSources(place, random, 14.0, 24.0);
  return place;
}

}  // namespace maneuver::data::town
