// A dual carriageway with an opening in its median, where vehicles make U-turns.

#include <numbers>
#include <vector>

#include "model/data/town/layouts.h"

namespace maneuver::data::town {

Place Turnaround(Random& random) {
  Place place;
  place.layout = "turnaround";
  RoadSpec road;
  road.forward = 2;
  road.backward = 2;
  road.lane_width = random.Uniform(3.3, 3.6);
  road.median = random.Uniform(5.0, 10.0);
  road.speed_limit = random.Uniform(10.0, 15.0);
  road.no_change_before_end = 30.0;
  const bool signals = random.Chance(0.3);
  std::vector<Arm> arms(2);
  for (int i = 0; i < 2; ++i) {
    arms[i].heading = i * std::numbers::pi;
    arms[i].spec = road;
    arms[i].length = random.Uniform(80.0, 95.0);
    arms[i].bend = random.Chance(0.4) ? random.Uniform(-0.3, 0.3) : 0.0;
    arms[i].signal_group = i;
  }
  if (signals) {
    place.signals.green = {random.Uniform(9.0, 15.0), random.Uniform(9.0, 15.0)};
    place.signals.offset = random.Uniform(0.0, place.signals.Cycle());
  }
  JunctionSpec spec;
  spec.control = signals ? Control::kSignals : Control::kYield;
  spec.crosswalks = false;
  spec.corner = random.Uniform(1.0, 4.0);
  spec.u_turn_weight = 4.0;
  const std::vector<Road> roads = AddJunction(place, arms, spec);
  place.walkers = random.Integer(4, 8);
  place.lane_change_rate = 0.03;
  place.initial_vehicles = random.Integer(10, 16);
  place.sensed_radius = random.Uniform(60.0, 75.0);
  AddSources(place, random, 5.0, 9.0);
  return place;
}

}  // namespace maneuver::data::town
