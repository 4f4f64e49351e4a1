// One place of the town: its lanes, signals, decoration and sources of traffic. Coordinates are in
// the place's own frame, whose origin is near its middle.

#ifndef MANEUVER_MODEL_DATA_TOWN_PLACE_H_
#define MANEUVER_MODEL_DATA_TOWN_PLACE_H_

#include <string>
#include <vector>

#include "model/data/town/lane_network.h"
#include "model/data/town/signals.h"

namespace maneuver::data::town {

enum class DecorationKind {
  kRoadLine,
  kRoadEdge,
  kCrosswalk,
  kStopLine,
  kSpeedBump,
  kDriveway,
  kStopSign,
};

struct Decoration {
  DecorationKind kind = DecorationKind::kRoadLine;
  std::vector<Vec2> points;
};

// Where vehicles (or bicycles) come from.
struct Source {
  int lane = 0;
  double mean_headway = 8.0;  // seconds between arrivals
};

// A path for people on foot, in either direction.
struct Footway {
  Path path;
  // The part of the path that crosses a road, in metres along it. Empty (from >= to) if none does.
  double crossing_from = 0.0;
  double crossing_to = 0.0;
  int signal_group = -1;    // vehicle group that must be red; -1 without signals
  double popularity = 1.0;  // relative share of the pedestrians who choose it
};

struct ParkedVehicle {
  PathPoint pose = {};
  double length = 4.6;        // metres
  double width = 1.85;        // metres
  int bay_lane = -1;          // pulls out along this lane, if not -1
  double leaves_after = 0.0;  // seconds after the recording's start (may be negative)
};

struct Place {
  std::string layout;  // name, lower_snake_case
  LaneNetwork graph;
  SignalPlan signals;
  std::vector<Decoration> decorations;
  std::vector<Source> sources;
  std::vector<Footway> footways;
  std::vector<ParkedVehicle> parked;
  int walkers = 4;                 // number of pedestrians
  double sensed_radius = 80.0;     // around the origin, metres
  double lane_change_rate = 0.02;  // wishes per second of a vehicle whose lane has a neighbour
  double long_vehicle_share = 0.06;
  int initial_vehicles = 12;
  double warm_up = 12.0;  // seconds of traffic before a recording starts
};

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_PLACE_H_
