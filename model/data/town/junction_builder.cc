#include <algorithm>
#include <array>
#include <numbers>

#include "model/data/town/road_builder.h"

namespace maneuver::data::town {
namespace {

constexpr double kTightestUTurn = 10.5;  // metres from lane to lane

Movement MovementOf(double angle) {
  if (std::abs(angle) > 2.6) return Movement::kUTurn;
  if (std::abs(angle) < 0.6) return Movement::kStraight;
  return angle > 0.0 ? Movement::kLeft : Movement::kRight;
}

int RankOf(Control control, bool major, Movement movement) {
  const bool left = movement == Movement::kLeft || movement == Movement::kUTurn;
  switch (control) {
    case Control::kAllWayStop:
      return 1;
    case Control::kSignals:
      return left ? 2 : 3;
    case Control::kStopSigns:
    case Control::kYield:
      return (major ? 3 : 1) + (left ? 0 : 1);
  }
  return 0;
}

GateKind KindOf(Control control, bool major) {
  switch (control) {
    case Control::kAllWayStop:
      return GateKind::kAllWayStop;
    case Control::kSignals:
      return GateKind::kSignal;
    case Control::kStopSigns:
      return major ? GateKind::kPriority : GateKind::kStopSign;
    case Control::kYield:
      return major ? GateKind::kPriority : GateKind::kYield;
  }
  return GateKind::kYield;
}

// Returns whether inbound lane `lane` of `lanes` (0 is the leftmost) serves a movement.
bool Serves(int lane, int lanes, Movement movement) {
  switch (movement) {
    case Movement::kLeft:
    case Movement::kUTurn:
      return lane == 0;
    case Movement::kRight:
      return lane == lanes - 1;
    default:
      return lanes < 3 || lane > 0;
  }
}

class Junction {
 public:
  Junction(Place& place, std::span<const Arm> arms, const JunctionSpec& spec)
      : place_(place), arms_(arms), spec_(spec) {}

  std::vector<Road> Build() {
    double half = 0.0;
    for (const Arm& arm : arms_) half = std::max(half, HalfWidth(arm));
    radius_ = half + spec_.corner;
    for (const Arm& arm : arms_) {
      RoadSpec road = arm.spec;
      road.footways = false;
      PathPen pen({.p = radius_ * Direction(arm.heading), .heading = arm.heading});
      pen.Straight(35.0);
      const double rest = arm.length - 35.0;
      const double curvature = arm.bend / rest;
      pen.Clothoid(0.5 * rest, 0.0, curvature).Clothoid(0.5 * rest, curvature, curvature);
      roads_.push_back(AddRoad(place_, pen.Done(), road));
    }
    for (size_t from = 0; from < arms_.size(); ++from) {
      for (size_t to = 0; to < arms_.size(); ++to) ConnectArms(from, to);
      Corner(from, (from + 1) % arms_.size());
      MarkStop(from);
      if (spec_.crosswalks) Crosswalk(from);
    }
    return roads_;
  }

 private:
  static double HalfWidth(const Arm& arm) {
    Road road;
    road.spec = arm.spec;
    return std::max(-road.right_edge(), road.left_edge());
  }

  double Weight(Movement movement) const {
    switch (movement) {
      case Movement::kLeft:
        return spec_.left_weight;
      case Movement::kRight:
        return spec_.right_weight;
      case Movement::kUTurn:
        return spec_.u_turn_weight;
      default:
        return spec_.straight_weight;
    }
  }

  void ConnectArms(size_t from, size_t to) {
    const double angle =
        from == to ? std::numbers::pi
                   : WrapAngle(arms_[to].heading - arms_[from].heading - std::numbers::pi);
    const Movement movement = MovementOf(angle);
    if (Weight(movement) <= 0.0 || (movement == Movement::kUTurn && from != to)) return;
    const std::vector<int>& in = roads_[from].backward;
    // A narrow road has no room for a U-turn.
    const RoadSpec& road = arms_[from].spec;
    const double across = road.median + road.forward * road.lane_width;
    if (movement == Movement::kUTurn && across < kTightestUTurn) return;
    const std::vector<int>& out = roads_[to].forward;
    const int lanes = static_cast<int>(in.size());
    const int exits = static_cast<int>(out.size());
    for (int lane = 0; lane < lanes; ++lane) {
      if (!Serves(lane, lanes, movement)) continue;
      int exit = 0;
      if (movement == Movement::kStraight) exit = exits - lanes + lane;
      if (movement == Movement::kRight || movement == Movement::kUTurn) exit = exits - 1;
      if (exit < 0 || exit >= exits) continue;
      AddConnector(in[lane], out[exit], from, movement, LaneKind::kConnector);
    }
    if (movement == Movement::kStraight && roads_[from].bike_backward >= 0 &&
        roads_[to].bike_forward >= 0) {
      AddConnector(roads_[from].bike_backward, roads_[to].bike_forward, from, movement,
                   LaneKind::kBike);
    }
  }

  void AddConnector(int from, int to, size_t arm, Movement movement, LaneKind kind) {
    const Path& before = place_.graph.lanes[from].path;
    const Path& after = place_.graph.lanes[to].path;
    Lane lane;
    lane.path = movement == Movement::kUTurn
                    ? UTurnPath(before.At(before.length()), after.At(0.0))
                    : ConnectPoses(before.At(before.length()), after.At(0.0));
    lane.width = place_.graph.lanes[from].width;
    lane.speed_limit = place_.graph.lanes[from].speed_limit;
    lane.kind = kind;
    lane.movement = movement;
    lane.next = {{.lane = to}};
    Gate gate;
    gate.kind = KindOf(spec_.control, arms_[arm].major);
    gate.rank = RankOf(spec_.control, arms_[arm].major, movement);
    if (spec_.control == Control::kSignals) gate.signal_group = arms_[arm].signal_group;
    lane.gate = gate;
    const int added = place_.graph.Add(std::move(lane));
    place_.graph.lanes[from].next.push_back({.lane = added, .weight = Weight(movement)});
  }

  // Adds the kerb and the footway from one arm to the next one counter-clockwise.
  void Corner(size_t from, size_t to) {
    const Road& a = roads_[from];
    const Road& b = roads_[to];
    const auto kerb = [&](double beyond) {
      const Path in = a.reference.Offset(a.left_edge() + beyond).Reversed();
      const Path out = b.reference.Offset(b.right_edge() - beyond);
      return std::array<Path, 3>{in, ConnectPoses(in.At(in.length()), out.At(0.0)), out};
    };
    AddLine(place_, DecorationKind::kRoadEdge, kerb(0.0)[1]);
    if (arms_[from].spec.footways) {
      AddFootway(place_, JoinPaths(kerb(kFootwayOffset)), 1.0);
    }
  }

  void MarkStop(size_t arm) {
    const Road& road = roads_[arm];
    const PathPoint at = road.reference.At(0.0);
    const Vec2 left = Left(Direction(at.heading));
    const bool free = KindOf(spec_.control, arms_[arm].major) == GateKind::kPriority;
    if (free || road.backward.empty()) return;
    const double inner = 0.5 * road.spec.median;
    place_.decorations.push_back(
        {DecorationKind::kStopLine, {at.p + inner * left, at.p + road.left_edge() * left}});
    if (spec_.control == Control::kStopSigns || spec_.control == Control::kAllWayStop) {
      place_.decorations.push_back(
          {DecorationKind::kStopSign, {at.p + (road.left_edge() + 0.8) * left}});
    }
  }

  void Crosswalk(size_t arm) {
    const Road& road = roads_[arm];
    const PathPoint origin = road.reference.At(0.0);
    const Vec2 out = Direction(origin.heading);
    const Vec2 left = Left(out);
    constexpr double kDepth = 3.0;  // metres
    const Vec2 middle = origin.p - (0.8 + 0.5 * kDepth) * out;
    PathPoint kerb{.p = middle + (road.right_edge() - kFootwayOffset) * left,
                   .heading = origin.heading + 0.5 * std::numbers::pi};
    const double across = road.left_edge() - road.right_edge();
    PathPen pen(kerb);
    const Path crossing = pen.Straight(across + 2.0 * kFootwayOffset).Done();
    AddArea(place_, DecorationKind::kCrosswalk, crossing, kFootwayOffset, kFootwayOffset + across,
            -0.5 * kDepth, 0.5 * kDepth);
    if (!arms_[arm].spec.footways) return;
    // Runs along the footway to the crossing, over it, and back out along the other footway.
    const Path right_way = road.reference.Offset(road.right_edge() - kFootwayOffset).Reversed();
    const Path left_way = road.reference.Offset(road.left_edge() + kFootwayOffset);
    const double turn = 2.5;
    const Path to_kerb = right_way.Slice(0.0, right_way.length() - turn);
    const Path over = crossing.Slice(turn, crossing.length() - turn);
    const Path from_kerb = left_way.Slice(turn, left_way.length());
    const std::array<Path, 5> parts = {
        to_kerb, ConnectPoses(to_kerb.At(to_kerb.length()), over.At(0.0)), over,
        ConnectPoses(over.At(over.length()), from_kerb.At(0.0)), from_kerb};
    Footway footway;
    footway.path = JoinPaths(parts);
    const double start = parts[0].length() + parts[1].length();
    footway.crossing_from = start - 1.2;
    footway.crossing_to = start + over.length() + 1.2;
    footway.popularity = 2.0;
    if (spec_.control == Control::kSignals) footway.signal_group = arms_[arm].signal_group;
    place_.footways.push_back(std::move(footway));
  }

  Place& place_;
  std::span<const Arm> arms_;
  const JunctionSpec& spec_;
  double radius_ = 0.0;
  std::vector<Road> roads_;
};

}  // namespace

std::vector<Road> AddJunction(Place& place, std::span<const Arm> arms, const JunctionSpec& spec) {
  return Junction(place, arms, spec).Build();
}

}  // namespace maneuver::data::town
