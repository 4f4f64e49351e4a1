#include "model/scene/lane_paths.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <span>
#include <tuple>
#include <utility>

#include "model/scene/lane_track.h"
#include "model/scene/target_frame.h"

namespace maneuver::scene {
namespace {

constexpr size_t kPoints = kLanePathDistances.size();
constexpr double kReach = 110.0;        // metres; the length of a path
constexpr double kStartDistance = 5.0;  // metres, from the target to the segment
constexpr double kStartCosine = 0.5;    // between the headings of the target and the segment
constexpr double kTurnCost = 4.0;       // metres
constexpr size_t kMostStarts = 6;
constexpr int kMostBranches = 5;         // paths of a start
constexpr int kMostWaysOn = 4;           // successors of a lane that are followed
constexpr size_t kMostExtensions = 128;  // of the paths of a start
constexpr double kSamePath = 1.5;        // metres, to an earlier path's lines; version 1: points
constexpr double kBehind = 1.0;          // metres; agents and signs are searched from this far
constexpr double kAhead = 80.0;          // behind the foot to this far ahead of it
constexpr double kLeaderDistance = 1.8;  // metres, from the path
constexpr double kLeaderAhead = 1.5;     // metres, from the foot along the path
constexpr double kSignDistance = 7.0;    // metres, from the path
constexpr double kSignalBehind = 3.0;    // metres, from the foot along the path
constexpr double kAbsentDistance =
    100.0;                            // metres; the distance that is written for an absent thing
constexpr double kMostSpeed = 100.0;  // metres per second
constexpr int kLookAheads = 5;        // seconds
constexpr double kLookAroundRadius = kStartDistance + kAhead + kSignDistance + 1.0;  // metres

// Another agent, at the time that is read.
struct Other {
  Point2 p_WA;
  double velocity_x;
  double velocity_y;
  double length;
};

// What a signal shows to a lane. The most restrictive light has the highest rank.
struct LaneSignal {
  int64_t lane_id;
  int rank;

  bool operator<(const LaneSignal& other) const {
    return std::tie(lane_id, rank) < std::tie(other.lane_id, other.rank);
  }
};

int RankOf(v1::TrafficSignalState state) {
  switch (state) {
    case v1::TRAFFIC_SIGNAL_STATE_STOP:
      return 3;
    case v1::TRAFFIC_SIGNAL_STATE_CAUTION:
      return 2;
    case v1::TRAFFIC_SIGNAL_STATE_GO:
      return 1;
    default:
      return 0;
  }
}

v1::TrafficSignalState StateOfRank(int rank) {
  constexpr v1::TrafficSignalState kStates[] = {
      v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED, v1::TRAFFIC_SIGNAL_STATE_GO,
      v1::TRAFFIC_SIGNAL_STATE_CAUTION, v1::TRAFFIC_SIGNAL_STATE_STOP};
  return kStates[rank];
}

double LimitedSpeed(double speed) { return std::clamp(speed, -kMostSpeed, kMostSpeed); }

// A lane that a path can begin on.
struct Start {
  double cost;
  int point;  // its foot is on the segment that begins at this point of the graph
  int lane;
  double foot;    // arc length
  double offset;  // of the target to the left of the lane, recorded world, metres
  Heading heading;

  bool operator<(const Start& other) const {
    return std::tie(cost, point) < std::tie(other.cost, other.point);
  }
};

// The starts with the least cost, each on a different lane.
class Starts {
 public:
  void Clear() { count_ = 0; }
  void Insert(const Start& start) {
    size_t i = 0;
    while (i < count_ && starts_[i].lane != start.lane) ++i;
    if (i == count_) {
      if (count_ < kMostStarts) {
        ++count_;
      } else if (start < starts_[--i]) {
        // The new start replaces the last one.
      } else {
        return;
      }
    } else if (!(start < starts_[i])) {
      return;
    }
    for (; i > 0 && start < starts_[i - 1]; --i) starts_[i] = starts_[i - 1];
    starts_[i] = start;
  }
  std::span<const Start> get() const { return {starts_.data(), count_}; }

 private:
  std::array<Start, kMostStarts> starts_;
  size_t count_ = 0;
};

// Maps from the recorded world to the target's frame in the view's world.
class Projection {
 public:
  Projection(const Pose2& X_WT, const WorldView& view)
      : X_WT_(X_WT), scale_(view.scale), left_(view.mirror ? -1.0 : 1.0) {}

  Point2 operator()(const Point2& p_WP) const {
    const Point2 p_TP = X_WT_.ToLocal(p_WP);
    return {scale_ * p_TP.x, left_ * scale_ * p_TP.y};
  }
  Heading operator()(const Heading& heading) const {
    return {X_WT_.cosine() * heading.cosine + X_WT_.sine() * heading.sine,
            left_ * (X_WT_.cosine() * heading.sine - X_WT_.sine() * heading.cosine)};
  }
  double left() const { return left_; }

 private:
  Pose2 X_WT_;
  double scale_;
  double left_;  // -1 in a mirror
};

double SquaredDistance(const Point2& a, const Point2& b) {
  const double dx = a.x - b.x;
  const double dy = a.y - b.y;
  return dx * dx + dy * dy;
}

// Returns the squared distance to the nearest of the lines between consecutive points of a path.
// The first and the last line have no end.
double SquaredDistance(const Point2& point, const std::array<Point2, kPoints>& path) {
  double nearest = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i + 1 < kPoints; ++i) {
    const double dx = path[i + 1].x - path[i].x;
    const double dy = path[i + 1].y - path[i].y;
    const double squared_length = dx * dx + dy * dy;
    if (squared_length == 0.0) continue;
    double share = ((point.x - path[i].x) * dx + (point.y - path[i].y) * dy) / squared_length;
    if (i > 0) share = std::max(share, 0.0);
    if (i + 2 < kPoints) share = std::min(share, 1.0);
    nearest = std::min(
        nearest, SquaredDistance(point, Point2{path[i].x + share * dx, path[i].y + share * dy}));
  }
  return nearest;
}

struct Leader {
  const Other* agent = nullptr;
  Passing passing;
};

struct SignalAhead {
  bool exists = false;
  v1::TrafficSignalState state = v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED;
  double distance = kAbsentDistance;  // recorded world, from the foot
  size_t leg = 0;
};

struct SignAhead {
  const Point2* place = nullptr;
  double distance = kAbsentDistance;  // recorded world, from the foot
};

// Writes numbers one after the other.
class Row {
 public:
  explicit Row(float* values) : next_(values) {}
  void Add(double value) { *next_++ = static_cast<float>(value); }
  void Add(const Point2& point, double divisor) {
    Add(point.x / divisor);
    Add(point.y / divisor);
  }
  const float* end() const { return next_; }

 private:
  float* next_;
};

}  // namespace

class LanePathFinder::Search {
 public:
  explicit Search(int inputs_version) : inputs_version_(inputs_version) {}

  void Find(const v1::Scenario& scenario, const LaneGraph& lanes, double time, int64_t target_id,
            const Pose2& X_WT, double speed, const WorldView& view, LanePathInputs* inputs) {
    assert(view.scale > 0.0);
    inputs->count = 0;
    inputs->values.fill(0.0F);
    scale_ = view.scale;
    const Projection projection(X_WT, view);
    ForEachPath(lanes, X_WT, projection, [&](const Start& start) {
      const auto path = static_cast<size_t>(inputs->count++);
      if (path == 0) LookAround(scenario, lanes, time, target_id, X_WT);
      WriteInputs(start, path, LimitedSpeed(speed), projection,
                  inputs->values.data() + path * kLanePathInputs);
    });
  }

  std::vector<LanePath> Describe(const v1::Scenario& scenario, const LaneGraph& lanes, double time,
                                 int64_t target_id, const Pose2& X_WT) {
    scale_ = 1.0;
    std::vector<LanePath> paths;
    ForEachPath(lanes, X_WT, Projection(X_WT, {}), [&](const Start& start) {
      if (paths.empty()) LookAround(scenario, lanes, time, target_id, X_WT);
      paths.push_back(DescribePath(start));
    });
    return paths;
  }

 private:
  // One lane of a path that is being extended.
  struct Node {
    int lane;
    int parent;  // the lane before it, in nodes_; -1: none
    // Arc lengths of its ends from the start of the path's first lane, recorded world.
    double start;
    double end;
  };

  // Calls call(start) for each path. During the call, track_, spots_ and points_ describe the path.
  template <typename Call>
  void ForEachPath(const LaneGraph& graph, const Pose2& X_WT, const Projection& projection,
                   Call call) {
    FindStarts(graph, X_WT);
    size_t kept = 0;
    for (const Start& start : starts_.get()) {
      nodes_.clear();
      nodes_.push_back({start.lane, -1, 0.0, graph.Length(graph.lane(start.lane))});
      int branches = 0;
      for (size_t i = 0; i < nodes_.size() && branches < kMostBranches; ++i) {
        if (Extend(graph, start, i)) continue;
        ++branches;
        MakeTrack(graph, start, i);
        ReadPoints(projection, &points_[kept]);
        if (RepeatsEarlierPath(kept)) continue;
        call(start);
        if (++kept == points_.size()) return;
      }
    }
  }

  void FindStarts(const LaneGraph& graph, const Pose2& X_WT) {
    starts_.Clear();
    const Point2 p_WT{X_WT.x(), X_WT.y()};
    const double reach = kStartDistance / scale_;
    graph.ForEachPieceNear(p_WT, reach, [&](const LanePiece& piece) {
      for (int i = piece.first; i < piece.last; ++i) {
        const LanePoint& point = graph.points()[static_cast<size_t>(i)];
        const double cosine = point.cosine * X_WT.cosine() + point.sine * X_WT.sine();
        if (cosine <= kStartCosine) continue;
        const double length = graph.points()[static_cast<size_t>(i) + 1].distance - point.distance;
        const double dx = p_WT.x - point.x;
        const double dy = p_WT.y - point.y;
        const double along = std::clamp(dx * point.cosine + dy * point.sine, 0.0, length);
        const double off_x = dx - along * point.cosine;
        const double off_y = dy - along * point.sine;
        const double squared = off_x * off_x + off_y * off_y;
        if (squared >= reach * reach) continue;
        starts_.Insert({.cost = scale_ * std::sqrt(squared) + kTurnCost * (1.0 - cosine),
                        .point = i,
                        .lane = piece.lane,
                        .foot = point.distance + along,
                        .offset = off_y * point.cosine - off_x * point.sine,
                        .heading = {point.cosine, point.sine}});
      }
    });
  }

  // Adds the successors of a node. Returns whether there are any; if not, its path is complete.
  bool Extend(const LaneGraph& graph, const Start& start, size_t index) {
    const Node node = nodes_[index];
    if (index >= kMostExtensions || scale_ * (node.end - start.foot) >= kReach) return false;
    const Lane& lane = graph.lane(node.lane);
    int ways = 0;
    for (const int next : graph.Successors(node.lane)) {
      if (ways == kMostWaysOn) break;
      if (Passes(index, next)) continue;
      const double begin = node.end + graph.Gap(lane, next);
      const double length = graph.Length(graph.lane(next));
      nodes_.push_back({next, static_cast<int>(index), begin, begin + length});
      ++ways;
    }
    return ways > 0;
  }

  // Returns whether the path that ends with a node contains the lane.
  bool Passes(size_t index, int lane) const {
    for (auto i = static_cast<int>(index); i >= 0; i = nodes_[static_cast<size_t>(i)].parent) {
      if (nodes_[static_cast<size_t>(i)].lane == lane) return true;
    }
    return false;
  }

  void MakeTrack(const LaneGraph& graph, const Start& start, size_t index) {
    track_.Begin(graph, start.foot);
    for (auto i = static_cast<int>(index); i >= 0; i = nodes_[static_cast<size_t>(i)].parent) {
      const Node& node = nodes_[static_cast<size_t>(i)];
      track_.AddLane(graph.lane(node.lane), node.start);
    }
    track_.Reverse();
  }

  void ReadPoints(const Projection& projection, std::array<Point2, kPoints>* points) {
    LaneTrack::Reader reader(track_);
    for (size_t i = 0; i < kPoints; ++i) {
      const Spot spot = reader(track_.foot() + kLanePathDistances[i] / scale_);
      (*points)[i] = projection(spot.p_WP);
      headings_[i] = projection(spot.heading);
    }
  }

  // Returns whether the path with the points points_[path] is close to an earlier one.
  bool RepeatsEarlierPath(size_t path) const {
    for (size_t other = 0; other < path; ++other) {
      bool same = true;
      // Compares from the far end, where paths differ most.
      for (size_t i = kPoints; i-- > 0 && same;) {
        const Point2& point = points_[path][i];
        const double squared = inputs_version_ < 2 ? SquaredDistance(point, points_[other][i])
                                                   : SquaredDistance(point, points_[other]);
        same = squared < kSamePath * kSamePath;
      }
      if (same) return true;
    }
    return false;
  }

  // Collects everything that a path may come near: agents, signals and stop signs.
  void LookAround(const v1::Scenario& scenario, const LaneGraph& graph, double time,
                  int64_t target_id, const Pose2& X_WT) {
    const double reach = kLookAroundRadius / scale_;
    const Box near{X_WT.x() - reach, X_WT.y() - reach, X_WT.x() + reach, X_WT.y() + reach};
    const auto is_near = [&near](double x, double y) {
      return x >= near.low_x && x <= near.high_x && y >= near.low_y && y <= near.high_y;
    };
    own_length_ = 0.0;
    others_.clear();
    for (const v1::Agent& agent : scenario.agents()) {
      if (agent.id() == target_id) {
        own_length_ = agent.length();
        continue;
      }
      const auto present =
          PresentOf(agent, time, OthersTolerance(inputs_version_), inputs_version_);
      if (!present || !is_near(present->position.x, present->position.y)) continue;
      others_.push_back({present->position, present->state->velocity_x(),
                         present->state->velocity_y(), agent.length()});
    }
    stop_signs_.clear();
    for (const Point2& sign : graph.stop_signs()) {
      if (is_near(sign.x, sign.y)) stop_signs_.push_back(sign);
    }
    ReadSignals(scenario, time);
  }

  void ReadSignals(const v1::Scenario& scenario, double time) {
    signals_.clear();
    for (const v1::TrafficSignal& signal : scenario.traffic_signals()) {
      const v1::TrafficSignalReading* const reading = LatestReading(signal, time);
      if (reading == nullptr || signal.lane_id() == 0) continue;
      signals_.push_back({signal.lane_id(), RankOf(reading->state())});
    }
    std::sort(signals_.begin(), signals_.end());
  }

  // What track_ comes near, after LookAround. Distances and arc lengths are those of the recorded
  // world.
  Leader FindLeader() const {
    Leader leader;
    for (const Other& other : others_) {
      const Passing passing = track_.NearestPoint(other.p_WA, kLeaderDistance / scale_);
      if (std::isinf(passing.squared_distance) ||
          passing.at <= track_.foot() + kLeaderAhead / scale_ ||
          (leader.agent != nullptr && passing.at >= leader.passing.at)) {
        continue;
      }
      leader = {&other, passing};
    }
    return leader;
  }

  SignalAhead FindSignal() const {
    if (signals_.empty()) return {};
    for (size_t leg = 0; leg < track_.legs(); ++leg) {
      const double distance = track_.start(leg) - track_.foot();
      if (distance <= -kSignalBehind / scale_) continue;
      // A lane's last signal is its most restrictive one.
      const int64_t id = track_.lane(leg).id;
      const auto after = std::upper_bound(signals_.begin(), signals_.end(),
                                          LaneSignal{id, std::numeric_limits<int>::max()});
      if (id == 0 || after == signals_.begin() || (after - 1)->lane_id != id) continue;
      return {true, StateOfRank((after - 1)->rank), distance, leg};
    }
    return {};
  }

  SignAhead FindStopSign() const {
    SignAhead ahead;
    for (const Point2& sign : stop_signs_) {
      const Passing passing = track_.NearestPoint(sign, kSignDistance / scale_);
      const double distance = passing.at - track_.foot();
      if (std::isinf(passing.squared_distance) ||
          (ahead.place != nullptr && distance >= ahead.distance)) {
        continue;
      }
      ahead = {&sign, distance};
    }
    return ahead;
  }

  // Selects the part of track_ on which agents and signs are searched.
  void SelectPart() {
    if (others_.empty() && stop_signs_.empty()) return;
    track_.SelectPart(track_.foot() - kBehind / scale_, track_.foot() + kAhead / scale_);
  }

  // Writes the 84 numbers of track_, the target's path number `path`.
  //   speed: of the target, recorded world.
  void WriteInputs(const Start& start, size_t path, double speed, const Projection& projection,
                   float* values) {
    SelectPart();
    Row row(values);
    for (size_t i = 0; i < kPoints; ++i) {
      row.Add(points_[path][i], std::max(kLanePathDistances[i], 5.0));
    }
    for (const Heading& heading : headings_) row.Add(heading.cosine);
    for (const Heading& heading : headings_) row.Add(heading.sine);
    assert(row.end() == values + LanePathRow::kLookAhead);
    WriteLookAhead(std::max(speed, 0.0), projection, &row);
    assert(row.end() == values + LanePathRow::kOffset);
    WriteStart(start, path == 0, projection, &row);
    assert(row.end() == values + LanePathRow::kHasLeader);
    WriteLeader(speed, &row);
    assert(row.end() == values + LanePathRow::kSignal);
    WriteSignal(&row);
    assert(row.end() == values + LanePathRow::kHasStopSign);
    WriteStopSign(&row);
    assert(row.end() == values + kLanePathInputs);
  }

  void WriteLookAhead(double speed, const Projection& projection, Row* row) const {
    LaneTrack::Reader reader(track_);
    for (int second = 1; second <= kLookAheads; ++second) {
      const double straight = speed * second;
      Point2 point = projection(reader(track_.foot() + straight).p_WP);
      point.x -= scale_ * straight;
      row->Add(point, 10.0);
    }
  }

  void WriteStart(const Start& start, bool is_first, const Projection& projection, Row* row) const {
    // The heading of the lane relative to the target's; the other way round, its sine changes sign.
    const Heading heading = projection(start.heading);
    row->Add(projection.left() * scale_ * start.offset);
    row->Add(-heading.sine);
    row->Add(heading.cosine);
    row->Add(std::min(scale_ * (track_.end() - track_.foot()), kReach) / 50.0);
    row->Add(start.cost / 3.0);
    row->Add(is_first ? 1.0 : 0.0);
    row->Add(scale_ * LimitedSpeed(track_.lane(0).speed_limit) / 15.0);
  }

  void WriteLeader(double speed, Row* row) const {
    const Leader leader = FindLeader();
    if (leader.agent == nullptr) {
      for (const double value : {0.0, kAbsentDistance / LanePathRow::kGapScale, 0.0, 0.0, 0.0})
        row->Add(value);
      return;
    }
    const Other& agent = *leader.agent;
    const Heading& heading = leader.passing.heading;
    const double gap =
        scale_ * (leader.passing.at - track_.foot() - 0.5 * (agent.length + own_length_));
    const double along =
        LimitedSpeed(agent.velocity_x * heading.cosine + agent.velocity_y * heading.sine);
    row->Add(1.0);
    row->Add(gap / LanePathRow::kGapScale);
    row->Add(scale_ * along / LanePathRow::kSpeedScale);
    row->Add(scale_ * (along - speed) / LanePathRow::kSpeedScale);
    row->Add(std::exp(-std::max(gap, 0.0) / 15.0));
  }

  void WriteSignal(Row* row) const {
    const SignalAhead signal = FindSignal();
    for (const v1::TrafficSignalState state :
         {v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED, v1::TRAFFIC_SIGNAL_STATE_STOP,
          v1::TRAFFIC_SIGNAL_STATE_CAUTION, v1::TRAFFIC_SIGNAL_STATE_GO}) {
      row->Add(signal.exists && signal.state == state ? 1.0 : 0.0);
    }
    const double distance = signal.exists ? scale_ * signal.distance : kAbsentDistance;
    const double closeness = std::exp(-std::max(distance, 0.0) / 15.0);
    row->Add((distance - DistanceOrigin()) / LanePathRow::kGapScale);
    row->Add(signal.state == v1::TRAFFIC_SIGNAL_STATE_STOP ? closeness : 0.0);
    row->Add(signal.state == v1::TRAFFIC_SIGNAL_STATE_CAUTION ? closeness : 0.0);
  }

  // The distance of a signal or a sign for which 0 is written.
  double DistanceOrigin() const { return inputs_version_ < 3 ? 0.0 : kAbsentDistance; }

  void WriteStopSign(Row* row) const {
    const SignAhead sign = FindStopSign();
    const double distance = sign.place != nullptr ? scale_ * sign.distance : kAbsentDistance;
    row->Add(sign.place != nullptr ? 1.0 : 0.0);
    row->Add((distance - DistanceOrigin()) / LanePathRow::kGapScale);
    row->Add(sign.place != nullptr ? std::exp(-std::abs(distance) / 10.0) : 0.0);
  }

  LanePath DescribePath(const Start& start) {
    SelectPart();
    LanePath path;
    path.cost = start.cost;
    track_.AppendCorners(track_.foot(), track_.foot() + kLanePathDistances.back(), &path.points);
    if (const Leader leader = FindLeader(); leader.agent != nullptr) {
      path.leader = leader.agent->p_WA;
    }
    if (const SignalAhead signal = FindSignal(); signal.exists) {
      const LanePoint& place = track_.lane_start(signal.leg);
      path.signal = Point2{place.x, place.y};
      path.signal_state = signal.state;
    }
    if (const SignAhead sign = FindStopSign(); sign.place != nullptr) path.stop_sign = *sign.place;
    return path;
  }

  int inputs_version_;
  // The target at hand.
  double scale_ = 1.0;
  Starts starts_;
  double own_length_ = 0.0;
  std::vector<Other> others_;        // agents that a path may come near
  std::vector<Point2> stop_signs_;   // metres, world
  std::vector<LaneSignal> signals_;  // in ascending order
  // The lanes reached from the start at hand, in the order of extension.
  std::vector<Node> nodes_;
  // The path at hand, and the points of the paths before it.
  LaneTrack track_;
  std::array<std::array<Point2, kPoints>, kMostLanePaths> points_;  // target's frame, the view's
  std::array<Heading, kPoints> headings_;                           // target's frame
};

LanePathFinder::LanePathFinder(int inputs_version)
    : search_(std::make_unique<Search>(inputs_version)) {}
LanePathFinder::~LanePathFinder() = default;
LanePathFinder::LanePathFinder(LanePathFinder&&) noexcept = default;
LanePathFinder& LanePathFinder::operator=(LanePathFinder&&) noexcept = default;

void LanePathFinder::Find(const v1::Scenario& scenario, const LaneGraph& lanes, double time,
                          int64_t target_id, const Pose2& X_WT, double speed, const WorldView& view,
                          LanePathInputs* inputs) {
  search_->Find(scenario, lanes, time, target_id, X_WT, speed, view, inputs);
}

std::vector<LanePath> LanePathFinder::Describe(const v1::Scenario& scenario, const LaneGraph& lanes,
                                               double time, int64_t target_id, const Pose2& X_WT) {
  return search_->Describe(scenario, lanes, time, target_id, X_WT);
}

}  // namespace maneuver::scene
