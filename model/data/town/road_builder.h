// Builds roads and junctions from lanes: geometry, paint, kerbs, footways, gates. Right-hand
// traffic.

#ifndef MANEUVER_MODEL_DATA_TOWN_ROAD_BUILDER_H_
#define MANEUVER_MODEL_DATA_TOWN_ROAD_BUILDER_H_

#include <span>
#include <vector>

#include "model/data/town/place.h"
#include "model/data/town/random.h"

namespace maneuver::data::town {

inline constexpr double kFootwayOffset = 1.9;  // metres from the kerb to where people walk

struct RoadSpec {
  int forward = 1;            // lanes along the reference line, on its right
  int backward = 1;           // lanes against it, on its left
  double lane_width = 3.5;    // metres
  double median = 0.0;        // metres between the directions
  double speed_limit = 13.9;  // metres per second
  bool bike_lanes = false;
  double parking = 0.0;  // metres of kerbside parking on each side
  bool footways = true;
  bool painted = true;
  bool kerbs = true;
  // Lane changes must begin at least this many metres before a lane's end.
  double no_change_before_end = 45.0;
};

// A road of a place. Lanes are counted from the middle outwards.
struct Road {
  Path reference;
  RoadSpec spec;
  std::vector<int> forward;
  std::vector<int> backward;
  int bike_forward = -1;
  int bike_backward = -1;

  double right_edge() const;  // offset of the right kerb from the reference line, negative
  double left_edge() const;
};

Road AddRoad(Place& place, const Path& reference, const RoadSpec& spec);

// A road out of a junction; its reference line leads outwards.
struct Arm {
  double heading = 0.0;  // radians
  RoadSpec spec;
  double length = 95.0;  // metres
  double bend = 0.0;     // radians; how far it turns on its way out
  bool major = true;     // has right of way over arms that are not
  int signal_group = 0;
};

enum class Control { kSignals, kStopSigns, kAllWayStop, kYield };

struct JunctionSpec {
  Control control = Control::kSignals;
  bool crosswalks = true;
  double corner = 7.5;  // metres from the kerbs' crossing to the stop lines
  // Relative shares of the vehicles that turn, as in LaneLink.
  double u_turn_weight = 0.0;
  double left_weight = 1.1;
  double straight_weight = 1.0;
  double right_weight = 1.0;
};

// Adds a junction of arms in counter-clockwise order. Returns their roads in the same order.
std::vector<Road> AddJunction(Place& place, std::span<const Arm> arms, const JunctionSpec& spec);

// Makes a traffic source of every lane that no other lane leads to, but not of bays and gated
// lanes. Mean headways are between `shortest` and `longest` seconds, and three times that for
// bicycles.
void AddSources(Place& place, Random& random, double shortest, double longest);

void AddLine(Place& place, DecorationKind kind, const Path& path);
// Adds the area between the distances `from` and `to` along a path, and between the offsets `right`
// and `left` from it (positive to the left). All in metres.
void AddArea(Place& place, DecorationKind kind, const Path& path, double from, double to,
             double right, double left);
// Adds a way on which pedestrians walk.
//   popularity: as in Footway
void AddFootway(Place& place, const Path& path, double popularity);
Path JoinPaths(std::span<const Path> paths);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_ROAD_BUILDER_H_
