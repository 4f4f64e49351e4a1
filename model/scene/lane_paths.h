// Lane paths: where a target can go along the lanes, as numbers for the networks.
//
// A lane path begins at the point of a lane nearest to the target, the foot, and goes on along the
// lanes that follow. Its points are found by arc length D from the foot. Between two lanes it runs
// straight, with the heading at the start of the second. Beyond the end of its last lane it goes
// straight on.
//
//              foot        D = 2.5        5          7.5
//      lane ----o-----------x------------x------------x---->
//               |                       /  another path, from the same foot
//               | offset              x
//               T----> +x (heading)
//
// Search.
//   1. A lane is a start if some segment of it is within 5 m of the target (as the distance between
//      the target's centre and the segment) and heads less than 60 degrees away from the target's
//      heading. Its foot is on the segment with the least cost,
//
//          cost = distance + 4 (1 - cos dh)       distance in metres, dh between the headings.
//
//      The six starts of least cost are followed, in ascending order.
//   2. From a start, paths are extended breadth first along LaneGraph::Successors, at most four at
//      each lane, never along a lane that the path has already, until a path is 110 m long or its
//      last lane has no further successor. The first five paths that are complete count. After 128
//      extensions a path counts as it is: forks without end take bounded time.
//   3. A path is dropped if all of its 13 points are within 1.5 m of those of an earlier path. The
//      first six that remain are the target's.
//
// Inputs. Row i of LanePathInputs describes path i by kLanePathInputs = 84 numbers. v is the
// target's speed; n the number of a point; D_n = 2.5 5 7.5 10 15 20 25 30 40 50 65 80 100 m.
//
//    0 .. 25  x and y of the path at D_n in the target's frame, divided by max(D_n, 5 m): x of
//             point 0, y of point 0, x of point 1, ...
//   26 .. 38  cosine of its heading at D_n relative to the target's
//   39 .. 51  sine of the same
//   52 .. 61  x and y, target's frame, of the path at D = max(v, 0) t minus (max(v, 0) t, 0), for
//             t = 1, 2, ... 5 s, by 10 m: where keeping to the path leads away from going straight
//         62  offset of the target from the foot, to the left of the lane, metres
//   63,   64  sine and cosine of the target's heading relative to the lane's at the foot
//         65  length of the path from the foot to the end of its last lane, at most 110 m, by 50 m
//         66  cost, divided by 3
//         67  1 for the first path, 0 for others
//         68  speed limit of the first lane, by 15 m/s; 0 if not known
//         69  1 if there is a leader: an agent other than the target whose centre is less than
//             1.8 m from the path, where the part from 1 m behind the foot to 80 m ahead of it
//             counts, and nearest to it more than 1.5 m ahead of the foot. The first one along the
//             path is the leader.
//         70  gap to the leader, by 30 m: arc length from foot to leader minus half of both
//             lengths; 100 m if there is none
//         71  the leader's speed along the path, by 10 m/s; 0 if there is none
//         72  that speed minus v, by 10 m/s; 0 if there is no leader
//         73  exp(-max(gap, 0) / 15 m); 0 if there is no leader
//   74 .. 77  the first lane of the path that has a signal and begins less than 3 m behind the
//             foot or ahead of it: 1 at 74 if the signal's light is not known, 75 if it shows stop,
//             76 caution, 77 go. All 0 if there is none. The most restrictive one of several
//             signals of a lane counts.
//         78  arc length d from the foot to the start of that lane, by 30 m; 100 m if there is none
//         79  exp(-max(d, 0) / 15 m) if it shows stop, otherwise 0
//         80  exp(-max(d, 0) / 15 m) if it shows caution, otherwise 0
//         81  1 if a stop sign is less than 7 m from the path, where the part from 1 m behind the
//             foot to 80 m ahead of it counts
//         82  arc length d from the foot to the point nearest to the first such sign, by 30 m;
//             100 m if there is none
//         83  exp(-|d| / 10 m) if there is one, otherwise 0
//
// The numbers are the same for every horizon that a model predicts. Over 3 s some of them tell more
// than is needed. Over 8 s the course of a lane beyond 100 m and 5 s ahead is not among them: paths
// go straight on there, and actions are held against that (action_geometry.h).
//
// Nobody is looked for in the gaps between lanes. Speeds and speed limits beyond 100 m/s count as
// 100 m/s.
//
// A WorldView with scale k gives the inputs of a world in which the map, the agents, their
// speeds and the speed limits are k times as large: a point at D is the recorded world's at D / k,
// times k. The successors of lanes stay those of the recorded map. A mirrored view gives those of a
// world in which left and right are swapped about the target's x axis: y, sines and the offset
// change sign. Moving the whole world by any SE(2) transform leaves the inputs as they were.
//
// Nothing later than the given time is looked at. Agents are where their latest state at or before
// that time puts them; an agent without a state in the kLanePathTolerance before it is absent.
// Signals show their latest reading at or before it; a signal without one is none.

#ifndef MANEUVER_MODEL_SCENE_LANE_PATHS_H_
#define MANEUVER_MODEL_SCENE_LANE_PATHS_H_

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "model/scene/lane_graph.h"
#include "model/scene/lane_path_inputs.h"
#include "model/scene/pose2.h"
#include "model/scene/world_view.h"

namespace maneuver::scene {

// Arc lengths from the foot at which paths are described, metres.
inline constexpr std::array<double, 13> kLanePathDistances = {
    2.5, 5.0, 7.5, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 65.0, 80.0, 100.0};
// How old an agent's state may be, seconds.
inline constexpr double kLanePathTolerance = 0.05;

// A lane path for drawing.
struct LanePath {
  std::vector<Point2> points;  // from the foot up to 100 m on, world, metres; at least two
  double cost = 0.0;           // of its start
  // Where these are: the leader's centre, the start of the lane that has the signal, the stop sign.
  std::optional<Point2> leader;
  std::optional<Point2> signal;
  v1::TrafficSignalState signal_state = v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED;
  std::optional<Point2> stop_sign;
};

// Finds the lane paths of targets. Holds scratch memory: one for each thread.
class LanePathFinder {
 public:
  LanePathFinder();
  ~LanePathFinder();
  LanePathFinder(LanePathFinder&&) noexcept;
  LanePathFinder& operator=(LanePathFinder&&) noexcept;

  // Writes the inputs of one target of `scenario`, which ValidateScenario accepts, at `time`.
  //   lanes: the lanes of the scenario's map (RoadMap::lanes).
  //   target_id: the agent that is no leader of itself. It need not be in the scenario; its length
  //     then counts as 0.
  //   X_WT: the target's frame. Position and heading are taken from it, not from the agent's state.
  //   speed: the target's, along its heading, m/s; negative: backwards. In the recorded world,
  //     whatever the view's scale.
  void Find(const v1::Scenario& scenario, const LaneGraph& lanes, double time, int64_t target_id,
            const Pose2& X_WT, double speed, const WorldView& view, LanePathInputs* inputs);

  // Returns the paths that Find() describes with WorldView{}, in the same order.
  std::vector<LanePath> Describe(const v1::Scenario& scenario, const LaneGraph& lanes, double time,
                                 int64_t target_id, const Pose2& X_WT);

 private:
  class Search;
  std::unique_ptr<Search> search_;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_LANE_PATHS_H_
