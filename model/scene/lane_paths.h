// Lane paths: the ways a target can take along the lanes, as numbers for the networks.
//
// A lane path begins at the foot, the point of a lane nearest to the target, and follows that lane
// and its successors. Its points are given by their arc length D from the foot. Between two lanes
// it runs straight, with the heading at the start of the second lane. Beyond its last lane it
// continues straight.
//
//              foot        D = 2.5        5          7.5
//      lane ----o-----------x------------x------------x---->
//               |                       /  another path, from the same foot
//               | offset              x
//               T----> +x (heading)
//
// Search.
//   1. A lane is a start if one of its segments is within 5 m of the target's centre and heads less
//      than 60 degrees away from the target's heading. The foot is on the segment of least cost,
//
//          cost = distance + 4 (1 - cos dh)       distance in metres, dh between the headings.
//
//      The six starts with the least cost are followed, in ascending order of cost.
//   2. From a start, paths are extended breadth first along LaneGraph::Successors, at most four per
//      lane, and never onto a lane that the path already contains. A path is complete when it is
//      110 m long or its last lane has no further successor. The first five complete paths of a
//      start count. After 128 extensions a path counts as it is, which bounds the time that forks
//      can take.
//   3. A path is dropped if all of its 13 points are within 1.5 m of an earlier path: of the lines
//      between that path's 13 points, which continue straight beyond both ends. Near the border
//      between two lanes, both are starts of the same way. The first six remaining paths are the
//      target's. With version 1 of the inputs (inputs_version.h), a path is dropped only if its
//      points are within 1.5 m of the points of an earlier path with the same numbers.
//
// Inputs. Row i of LanePathInputs describes path i by kLanePathInputs = 84 numbers. v is the
// target's speed, n the number of a point, and D_n = 2.5 5 7.5 10 15 20 25 30 40 50 65 80 100 m.
// "By 10 m" means divided by 10 m.
//
//    0 .. 25  x and y of the path at D_n in the target's frame, divided by max(D_n, 5 m): x of
//             point 0, y of point 0, x of point 1, ...
//   26 .. 38  cosine of its heading at D_n relative to the target's
//   39 .. 51  sine of that relative heading
//   52 .. 61  x and y, target's frame, of the path at D = max(v, 0) t minus (max(v, 0) t, 0), for
//             t = 1, 2, ... 5 s, by 10 m: how far following the path departs from going straight
//         62  offset of the target from the foot, to the left of the lane, metres
//   63,   64  sine and cosine of the target's heading relative to the lane's at the foot
//         65  length of the path from the foot to the end of its last lane, at most 110 m, by 50 m
//         66  cost, divided by 3
//         67  1 for the first path, 0 for others
//         68  speed limit of the first lane, by 15 m/s; 0 if not known
//         69  1 if there is a leader. The leader is the first agent along the path that is not the
//             target, whose centre is less than 1.8 m from the path, and whose nearest point on the
//             path is more than 1.5 m ahead of the foot. The path is searched from 1 m behind the
//             foot to 80 m ahead of it.
//         70  gap to the leader, by 30 m: arc length from foot to leader minus half of both
//             vehicles' lengths; 100 m if there is no leader
//         71  the leader's speed along the path, by 10 m/s; 0 if there is none
//         72  that speed minus v, by 10 m/s; 0 if there is no leader
//         73  exp(-max(gap, 0) / 15 m); 0 if there is no leader
//   74 .. 77  the signal of the first lane of the path that has one and that begins ahead of the
//             foot, or less than 3 m behind it: 74 is 1 if its state is unknown, 75 if it shows
//             stop, 76 caution, 77 go. All are 0 if there is none. If several signals control the
//             lane, the most restrictive one counts.
//         78  arc length d from the foot to the start of that lane, minus 100 m, by 30 m; 0 if
//             there is none
//         79  exp(-max(d, 0) / 15 m) if it shows stop, otherwise 0
//         80  exp(-max(d, 0) / 15 m) if it shows caution, otherwise 0
//         81  1 if a stop sign is less than 7 m from the path. The path is searched from 1 m behind
//             the foot to 80 m ahead of it.
//         82  arc length d from the foot to the point nearest to the first such sign, minus 100 m,
//             by 30 m; 0 if there is none
//         83  exp(-|d| / 10 m) if there is one, otherwise 0
//
// So 74 .. 83 are all 0 without signals and signs, and nothing is learned from them about scenes
// that have some. With versions 1 and 2 of the inputs, 78 and 82 are d by 30 m, and 100 m by 30 m
// if there is none: their weights then learn as biases do, and act where there is a signal.
//
// The numbers do not depend on the horizon that a model predicts. For a horizon of 3 s, some say
// more than is needed. For 8 s, they do not tell where a lane goes beyond 100 m or beyond 5 s:
// paths continue straight there, and actions are compared with that (action_geometry.h).
//
// The gaps between lanes are not searched for leaders. Speeds and speed limits above 100 m/s count
// as 100 m/s.
//
// A WorldView with scale k gives the inputs of a world whose map, agents, speeds and speed limits
// are k times as large: a point at D is the recorded world's point at D / k, times k. The
// successors of lanes stay those of the recorded map. A mirrored view swaps left and right about
// the target's x axis: y, sines and the offset change sign. An SE(2) transform of the whole world
// leaves the inputs unchanged.
//
// Reads nothing later than the given time. An agent has gone on at its velocity from its latest
// state; one whose state is older than OthersTolerance (target_frame.h) is absent. A signal
// shows its latest reading at or before that time; a signal without one is ignored.

#ifndef MANEUVER_MODEL_SCENE_LANE_PATHS_H_
#define MANEUVER_MODEL_SCENE_LANE_PATHS_H_

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "model/scene/inputs_version.h"
#include "model/scene/lane_graph.h"
#include "model/scene/lane_path_inputs.h"
#include "model/scene/pose2.h"
#include "model/scene/world_view.h"

namespace maneuver::scene {

// How old an agent's state may be, seconds.

// A lane path, for drawing.
struct LanePath {
  std::vector<Point2> points;  // from the foot to 100 m ahead, world, metres; at least two
  double cost = 0.0;           // of its start
  // Positions: the leader's centre, the start of the lane that has the signal, the stop sign.
  std::optional<Point2> leader;
  std::optional<Point2> signal;
  v1::TrafficSignalState signal_state = v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED;
  std::optional<Point2> stop_sign;
};

// Finds the lane paths of targets. Holds scratch memory: use one per thread.
class LanePathFinder {
 public:
  explicit LanePathFinder(int inputs_version = kLatestInputsVersion);
  ~LanePathFinder();
  LanePathFinder(LanePathFinder&&) noexcept;
  LanePathFinder& operator=(LanePathFinder&&) noexcept;

  // Writes the inputs of one target of `scenario` at `time`. ValidateScenario must accept the
  // scenario.
  //   lanes: the lanes of the scenario's map (RoadMap::lanes).
  //   target_id: the agent that is never its own leader. It need not be in the scenario; its length
  //     then counts as 0.
  //   X_WT: the target's frame. Position and heading come from here, not from the agent's state.
  //   speed: of the target, along its heading, in the recorded world whatever the view's scale,
  //     m/s; negative when it moves backwards.
  void Find(const v1::Scenario& scenario, const LaneGraph& lanes, double time, int64_t target_id,
            const Pose2& X_WT, double speed, const WorldView& view, LanePathInputs* inputs);

  // Returns the paths that Find() describes with the default WorldView, in the same order.
  std::vector<LanePath> Describe(const v1::Scenario& scenario, const LaneGraph& lanes, double time,
                                 int64_t target_id, const Pose2& X_WT);

 private:
  class Search;
  std::unique_ptr<Search> search_;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_LANE_PATHS_H_
