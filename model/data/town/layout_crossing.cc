#include <vector>

#include "model/data/town/layouts.h"

namespace maneuver::data::town {
namespace {

RoadSpec Street(Random& random, int lanes) {
  RoadSpec spec;
  spec.forward = lanes;
  spec.backward = lanes;
  spec.lane_width = random.Uniform(3.2, 3.6);
  spec.speed_limit = lanes == 1 ? random.Uniform(8.0, 13.9) : random.Uniform(11.0, 16.5);
  return spec;
}

void RandomizeArm(Arm& arm, Random& random) {
  arm.length = random.Uniform(72.0, 90.0);
  arm.bend = random.Chance(0.4) ? random.Uniform(-0.6, 0.6) : 0.0;
}

SignalPlan DrawPlan(Random& random) {
  SignalPlan plan;
  plan.green = {random.Uniform(9.0, 17.0), random.Uniform(9.0, 17.0)};
  plan.offset = random.Uniform(0.0, plan.Cycle());
  return plan;
}

void AddDriveway(Place& place, const Road& road, Random& random) {
  const double s = random.Uniform(20.0, 60.0);
  AddArea(place, DecorationKind::kDriveway, road.reference, s, s + 5.0, road.right_edge() - 4.0,
          road.right_edge());
}

}  // namespace

Place SignalCrossing(Random& random) {
  Place place;
  place.layout = "signal_crossing";
  place.signals = DrawPlan(random);
  RoadSpec main = Street(random, random.Integer(1, 3));
  RoadSpec side = Street(random, random.Integer(1, 2));
  main.median = main.forward > 1 && random.Chance(0.4) ? random.Uniform(1.5, 4.5) : 0.0;
  main.bike_lanes = random.Chance(0.35);
  side.bike_lanes = main.bike_lanes && random.Chance(0.5);
  std::vector<Arm> arms(4);
  for (int i = 0; i < 4; ++i) {
    arms[i].heading = i * kQuarter + random.Uniform(-0.12, 0.12);
    arms[i].spec = i % 2 == 0 ? main : side;
    arms[i].signal_group = i % 2;
    RandomizeArm(arms[i], random);
  }
  JunctionSpec spec;
  spec.control = Control::kSignals;
  spec.corner = random.Uniform(7.0, 9.5);
  spec.left_weight = 2.2;
  spec.right_weight = 2.0;
  if (main.median > 3.0) spec.u_turn_weight = 0.6;
  const std::vector<Road> roads = AddJunction(place, arms, spec);
  AddDriveway(place, roads[random.Integer(0, 3)], random);
  place.walkers = random.Integer(5, 11);
  place.initial_vehicles = random.Integer(10, 20);
  place.sensed_radius = random.Uniform(52.0, 68.0);
  AddSources(place, random, 7.0, 16.0);
  return place;
}

Place StopCrossing(Random& random) {
  Place place;
  place.layout = "stop_crossing";
  const bool all_way = random.Chance(0.45);
  RoadSpec main = Street(random, all_way ? 1 : random.Integer(1, 2));
  RoadSpec side = Street(random, 1);
  main.parking = random.Chance(0.25) ? 2.4 : 0.0;
  std::vector<Arm> arms(4);
  for (int i = 0; i < 4; ++i) {
    arms[i].heading = i * kQuarter + random.Uniform(-0.15, 0.15);
    arms[i].spec = i % 2 == 0 ? main : side;
    arms[i].major = i % 2 == 0;
    RandomizeArm(arms[i], random);
  }
  JunctionSpec spec;
  spec.control = all_way               ? Control::kAllWayStop
                 : random.Chance(0.65) ? Control::kStopSigns
                                       : Control::kYield;
  spec.crosswalks = all_way;
  spec.corner = random.Uniform(6.5, 9.0);
  spec.left_weight = 2.4;
  spec.right_weight = 2.4;
  const std::vector<Road> roads = AddJunction(place, arms, spec);
  for (size_t i = 0; i < roads.size(); ++i) {
    if (roads[i].spec.parking <= 0.0) continue;
    ParkAlong(place, roads[i], true, 0.4, random);
    ParkAlong(place, roads[i], false, 0.4, random);
  }
  AddDriveway(place, roads[1], random);
  place.walkers = random.Integer(5, 10);
  place.initial_vehicles = random.Integer(7, 11);
  place.sensed_radius = random.Uniform(52.0, 68.0);
  AddSources(place, random, all_way ? 11.0 : 7.0, all_way ? 18.0 : 14.0);
  return place;
}

Place TJunction(Random& random) {
  Place place;
  place.layout = "t_junction";
  const bool signals = random.Chance(0.35);
  if (signals) place.signals = DrawPlan(random);
  const RoadSpec main = Street(random, random.Integer(1, 2));
  const RoadSpec stem = Street(random, 1);
  std::vector<Arm> arms(3);
  for (int i = 0; i < 3; ++i) {
    arms[i].heading = (i == 2 ? 3 : 2 * i) * kQuarter + random.Uniform(-0.12, 0.12);
    arms[i].spec = i == 2 ? stem : main;
    arms[i].major = i != 2;
    arms[i].signal_group = i == 2 ? 1 : 0;
    RandomizeArm(arms[i], random);
  }
  JunctionSpec spec;
  spec.control = signals              ? Control::kSignals
                 : random.Chance(0.5) ? Control::kStopSigns
                                      : Control::kYield;
  spec.crosswalks = signals;
  spec.corner = random.Uniform(6.5, 9.5);
  spec.left_weight = 2.4;
  spec.right_weight = 2.4;
  const std::vector<Road> roads = AddJunction(place, arms, spec);
  AddDriveway(place, roads[0], random);
  place.walkers = random.Integer(5, 10);
  place.initial_vehicles = random.Integer(8, 15);
  place.sensed_radius = random.Uniform(52.0, 68.0);
  AddSources(place, random, 6.0, 11.0);
  return place;
}

}  // namespace maneuver::data::town
