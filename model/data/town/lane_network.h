// Lanes, which lanes follow each other, and where lanes cross.

#ifndef MANEUVER_MODEL_DATA_TOWN_LANE_NETWORK_H_
#define MANEUVER_MODEL_DATA_TOWN_LANE_NETWORK_H_

#include <optional>
#include <vector>

#include "model/data/town/path.h"

namespace maneuver::data::town {

enum class LaneKind {
  kRoad,       // an ordinary piece of road
  kConnector,  // through a junction
  kRing,       // a piece of a roundabout's ring
  kAisle,      // between the bays of a car park
  kBay,        // out of a parking bay
  kBike,       // for bicycles
};

// What a road user does by following the lane.
enum class Movement { kAlong, kStraight, kLeft, kRight, kUTurn, kRoundabout, kParkOut };

// A continuation at the end of a lane.
struct LaneLink {
  int lane = 0;
  double at = 0.0;      // metres along `lane` to the point where it is joined
  double weight = 1.0;  // relative share of the road users who choose it
};

enum class GateKind {
  kSignal,      // obey the signal, then give way
  kStopSign,    // stop, then give way
  kAllWayStop,  // stop, then first come, first served
  kYield,       // give way without stopping
  kPriority,    // go unless someone is already in the way
};

// A part of a gated lane that overlaps a part of another lane.
struct Conflict {
  int lane = 0;
  double from = 0.0;  // metres along the gated lane
  double to = 0.0;
  double lane_from = 0.0;  // metres along `lane`
  double lane_to = 0.0;
  bool merge = false;  // both lanes lead into the same lane
};

// The gate at the start of a lane: nobody enters the lane without permission.
struct Gate {
  GateKind kind = GateKind::kYield;
  int signal_group = -1;  // of the place's signals, for kSignal
  int rank = 0;           // vehicles give way to gates of higher rank
  std::vector<Conflict> conflicts = {};
};

struct Lane {
  Path path;
  double width = 3.5;         // metres
  double speed_limit = 13.9;  // metres per second
  LaneKind kind = LaneKind::kRoad;
  Movement movement = Movement::kAlong;
  std::vector<LaneLink> next;
  int left = -1;  // neighbours in the same direction, for lane changes
  int right = -1;
  double change_from = 0.0;  // a lane change may begin from here, metres along the lane,
  double change_to = 0.0;    // to here
  bool ends = false;         // an on-ramp: vehicles must move left before its end
  bool reverse = false;      // driven backwards, and stopped at its end
  std::optional<Gate> gate;
};

struct LaneNetwork {
  std::vector<Lane> lanes;

  int Add(Lane lane);
  // Finds the conflicts of every gated lane with every other lane. Consecutive lanes, and lanes
  // that leave the same lane, do not conflict: car-following handles them.
  void FindConflicts();
  // Returns, for each lane, the lanes that lead to its start.
  std::vector<std::vector<int>> Predecessors() const;
};

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_LANE_NETWORK_H_
