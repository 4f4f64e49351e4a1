#include "model/scene/action_geometry.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace maneuver::scene {
namespace {

constexpr int kPathPoints = static_cast<int>(kLanePathDistances.size());
// Arc lengths of a path's points, metres: 0 for the foot, then the others.
constexpr auto kArcLengths = [] {
  std::array<float, kPathPoints + 1> lengths{};
  for (int i = 0; i < kPathPoints; ++i) {
    lengths[i + 1] = static_cast<float>(kLanePathDistances[i]);
  }
  return lengths;
}();
constexpr float kGapScale = static_cast<float>(LanePathRow::kGapScale);
constexpr float kSpeedScale = static_cast<float>(LanePathRow::kSpeedScale);
constexpr float kLeastScale = 5.0f;  // points are divided by at least this, metres
constexpr float kBeyond = 1000.0f;   // how far the first and last segment extend, metres
constexpr float kShortest = 1e-3f;   // shorter segments have no direction of their own, metres
// By how much a later segment's squared distance must be smaller. Far above rounding errors.
constexpr float kMarginShare = 1e-4f;
constexpr float kLeastMargin = 1e-5f;  // square metres
constexpr float kSlowest = 0.5f;       // below this an action has no direction, m/s

// A piece of a path: points start + a * direction, a from `least` to `most`.
struct Segment {
  float start_x, start_y;
  float direction_x, direction_y;
  float least, most;  // metres from the start
  float arc_length;   // nominal, of the start
};
using Polyline = std::array<Segment, kPathPoints>;

// Returns the target's foot on a path, target frame, metres.
std::array<float, 2> FindFoot(const float* path, int inputs_version) {
  if (inputs_version < 2) {
    // Heading of the path at the foot, relative to the target's.
    const float heading = -std::asin(std::clamp(path[LanePathRow::kHeadingSine], -1.0f, 1.0f));
    return {path[LanePathRow::kOffset] * std::sin(heading),
            -path[LanePathRow::kOffset] * std::cos(heading)};
  }
  const float x = path[LanePathRow::kHeadingCosine] + path[LanePathRow::kCosines];
  const float y = path[LanePathRow::kSines] - path[LanePathRow::kHeadingSine];
  const float back = kArcLengths[1] / std::max(std::sqrt(x * x + y * y), kShortest);
  return {path[0] * kLeastScale - back * x, path[1] * kLeastScale - back * y};
}

Polyline ReadPolyline(const float* path, int inputs_version) {
  auto [x, y] = FindFoot(path, inputs_version);
  Polyline polyline;
  for (int i = 0; i < kPathPoints; ++i) {
    const float scale = std::max(kArcLengths[i + 1], kLeastScale);
    const float next_x = path[2 * i] * scale;
    const float next_y = path[2 * i + 1] * scale;
    const float length = std::sqrt((next_x - x) * (next_x - x) + (next_y - y) * (next_y - y));
    const bool directed = length >= kShortest;
    polyline[i] = {.start_x = x,
                   .start_y = y,
                   .direction_x = directed ? (next_x - x) / length : 1.0f,
                   .direction_y = directed ? (next_y - y) / length : 0.0f,
                   .least = i == 0 ? -kBeyond : 0.0f,
                   .most = i + 1 == kPathPoints ? kBeyond : length,
                   .arc_length = kArcLengths[i]};
    x = next_x;
    y = next_y;
  }
  return polyline;
}

// Actions are processed in blocks. The points of a block lie side by side, so that the search for
// the nearest segment is vectorised. A point's numbers are the same bits whatever else its block
// holds.
constexpr int kBlockActions = 32;
constexpr int kBlockPoints = kBlockActions * kGeometryTimes;
using BlockOf = std::array<float, kBlockPoints>;

// Positions and directions of actions; point a * kGeometryTimes + t is action a at time t.
struct Points {
  alignas(64) BlockOf x;
  alignas(64) BlockOf y;
  BlockOf speed;
  BlockOf direction_x;
  BlockOf direction_y;
};

// Each point's position relative to its nearest segment.
struct Projections {
  alignas(64) BlockOf squared_distance;
  alignas(64) BlockOf offset;      // to the left, metres
  alignas(64) BlockOf arc_length;  // metres
  alignas(64) std::array<int, kBlockPoints> segment;
};

void ReadPoints(std::span<const ActionPoints> actions, const GeometryWaypoints& waypoints,
                Points& points) {
  for (size_t a = 0; a < actions.size(); ++a) {
    for (int t = 0; t < kGeometryTimes; ++t) {
      const auto& at = actions[a].at[t];
      const auto& before = actions[a].before[t];
      const auto step = static_cast<float>(waypoints.steps[t]);
      const float velocity_x = (at[0] - before[0]) / step;
      const float velocity_y = (at[1] - before[1]) / step;
      const float speed = std::sqrt(velocity_x * velocity_x + velocity_y * velocity_y);
      const bool directed = speed > kSlowest;
      const size_t i = a * kGeometryTimes + t;
      points.x[i] = at[0];
      points.y[i] = at[1];
      points.speed[i] = speed;
      points.direction_x[i] = directed ? velocity_x / speed : 1.0f;
      points.direction_y[i] = directed ? velocity_y / speed : 0.0f;
    }
  }
}

// Projects the points onto a segment. Writes, for each point, the nearer of that projection and the
// one in `before`.
//
// `before` and `after` must differ: updating in place makes GCC store under a mask, which takes
// three times as long.
void Meet(const Polyline& polyline, int index, const Points& points, int count,
          const Projections& before, Projections& after) {
  const Segment segment = polyline[index];
  for (int i = 0; i < count; ++i) {
    const float x = points.x[i] - segment.start_x;
    const float y = points.y[i] - segment.start_y;
    const float along = x * segment.direction_x + y * segment.direction_y;
    const float across = segment.direction_x * y - segment.direction_y * x;
    const float within = std::min(std::max(along, segment.least), segment.most);
    const float beyond = along - within;
    const float squared = across * across + beyond * beyond;
    const float margin = kMarginShare * before.squared_distance[i] + kLeastMargin;
    const bool nearer = squared < before.squared_distance[i] - margin;
    after.squared_distance[i] = nearer ? squared : before.squared_distance[i];
    after.offset[i] = nearer ? across : before.offset[i];
    after.arc_length[i] = nearer ? segment.arc_length + within : before.arc_length[i];
    after.segment[i] = nearer ? index : before.segment[i];
  }
}

// Projects the points onto a path. Returns the buffer that holds the result.
const Projections& Project(const Polyline& polyline, const Points& points, int count,
                           std::array<Projections, 2>& projections) {
  projections[0].squared_distance.fill(1e30f);
  projections[0].offset.fill(0.0f);
  projections[0].arc_length.fill(0.0f);
  projections[0].segment.fill(0);
  for (int s = 0; s < kPathPoints; ++s) {
    Meet(polyline, s, points, count, projections[s % 2], projections[(s + 1) % 2]);
  }
  return projections[kPathPoints % 2];
}

// Writes the kPairNumbers of an action and a path. `first` is the index of the action's first
// point.
void WritePair(const Points& points, const Polyline& polyline, const Projections& nearest,
               int first, const GeometryWaypoints& waypoints, const float* path, float* pair) {
  const int last = first + kGeometryTimes - 1;
  for (int t = 0; t < kGeometryTimes; ++t) {
    const int i = first + t;
    pair[t] = std::clamp(nearest.offset[i] / 3.0f, -2.0f, 2.0f);
    pair[3 + t] = std::exp(-std::sqrt(nearest.squared_distance[i]));
    const Segment& segment = polyline[nearest.segment[i]];
    pair[6 + t] =
        segment.direction_x * points.direction_y[i] - segment.direction_y * points.direction_x[i];
  }
  const Segment& segment = polyline[nearest.segment[last]];
  pair[9] = segment.direction_x * points.direction_x[last] +
            segment.direction_y * points.direction_y[last];
  pair[10] = nearest.arc_length[last] / 50.0f;
  pair[11] = path[LanePathRow::kLengthLeft] - pair[10];
  const bool leader = path[LanePathRow::kHasLeader] > 0.5f;
  for (int t = 0; t < kGeometryTimes; ++t) {
    const float gap =
        path[LanePathRow::kLeaderGap] * kGapScale +
        path[LanePathRow::kLeaderSpeed] * kSpeedScale * static_cast<float>(waypoints.times[t]) -
        nearest.arc_length[first + t];
    pair[12 + t] = leader ? std::clamp(gap / 10.0f, -2.0f, 3.0f) : 0.0f;
  }
  pair[15] = leader ? 1.0f : 0.0f;
  const bool stop_sign = path[LanePathRow::kHasStopSign] > 0.5f;
  const float stop = path[LanePathRow::kStopSignDistance] * kGapScale;
  pair[16] = stop_sign ? std::clamp((stop - nearest.arc_length[first]) / 10.0f, -2.0f, 2.0f) : 0.0f;
  pair[17] = stop_sign ? std::clamp((stop - nearest.arc_length[last]) / 10.0f, -2.0f, 2.0f) : 0.0f;
}

// Writes the kActionNumbers of an action.
void WriteAction(const Points& points, int first, float speed, float* action) {
  const int last = first + kGeometryTimes - 1;
  action[0] = points.x[last] / 50.0f;
  action[1] = points.y[last] / 20.0f;
  action[2] = points.x[first] / 20.0f;
  action[3] = points.y[first] / 10.0f;
  for (int t = 0; t < kGeometryTimes; ++t) action[4 + t] = points.speed[first + t] / 15.0f;
  action[7] = points.direction_x[first + 1];
  action[8] = points.direction_y[first + 1];
  action[9] = points.direction_x[last];
  action[10] = points.direction_y[last];
  action[11] = (points.speed[last] - speed) / 10.0f;
  action[12] = std::exp(-points.speed[last]);
}

// Returns the waypoint nearest to `time` among the first `count`, the earlier one of two that are
// equally near. Returns -1 if the prediction time is nearer than all of them.
int NearestWaypoint(std::span<const double> waypoint_times, size_t count, double time) {
  constexpr double kRounding = 1e-9;
  int nearest = -1;
  double distance = std::abs(time);
  for (size_t i = 0; i < count; ++i) {
    const double other = std::abs(waypoint_times[i] - time);
    if (other < distance - kRounding) {
      nearest = static_cast<int>(i);
      distance = other;
    }
  }
  return nearest;
}

}  // namespace

GeometryWaypoints FindGeometryWaypoints(std::span<const double> waypoint_times) {
  constexpr std::array<double, kGeometryTimes> kShares = {0.4, 0.7, 1.0};
  constexpr double kVelocityStep = 0.5;
  GeometryWaypoints found;
  for (int t = 0; t < kGeometryTimes; ++t) {
    const int at = std::max(0, NearestWaypoint(waypoint_times, waypoint_times.size(),
                                               kShares[t] * waypoint_times.back()));
    const double time = waypoint_times[at];
    const int before = NearestWaypoint(waypoint_times, at, time - kVelocityStep);
    found.at[t] = at;
    found.before[t] = before;
    found.times[t] = time;
    found.steps[t] = time - (before < 0 ? 0.0 : waypoint_times[before]);
  }
  return found;
}

void DescribeActions(std::span<const ActionPoints> trajectories, const GeometryWaypoints& waypoints,
                     const LanePathInputs& paths, double speed, int inputs_version,
                     std::span<float> pairs, std::span<float> actions) {
  constexpr int kActionPairs = kMostLanePaths * kPairNumbers;
  std::fill(pairs.begin(), pairs.end(), 0.0f);
  std::array<Polyline, kMostLanePaths> polylines;
  for (int p = 0; p < paths.count; ++p) {
    polylines[p] = ReadPolyline(&paths.values[p * kLanePathInputs], inputs_version);
  }
  Points points;
  std::array<Projections, 2> projections;
  for (size_t start = 0; start < trajectories.size(); start += kBlockActions) {
    const std::span<const ActionPoints> block =
        trajectories.subspan(start, std::min<size_t>(kBlockActions, trajectories.size() - start));
    const int block_points = static_cast<int>(block.size()) * kGeometryTimes;
    ReadPoints(block, waypoints, points);
    for (size_t a = 0; a < block.size(); ++a) {
      WriteAction(points, static_cast<int>(a) * kGeometryTimes, static_cast<float>(speed),
                  &actions[(start + a) * kActionNumbers]);
    }
    for (int p = 0; p < paths.count; ++p) {
      const Projections& nearest = Project(polylines[p], points, block_points, projections);
      for (size_t a = 0; a < block.size(); ++a) {
        WritePair(points, polylines[p], nearest, static_cast<int>(a) * kGeometryTimes, waypoints,
                  &paths.values[p * kLanePathInputs],
                  &pairs[(start + a) * kActionPairs + p * kPairNumbers]);
      }
    }
  }
}

}  // namespace maneuver::scene
