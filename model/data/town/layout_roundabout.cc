#include <algorithm>
#include <numbers>
#include <vector>

#include "model/data/town/layouts.h"

namespace maneuver::data::town {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;

PathPoint OnRing(double radius, double angle) {
  return {
      .p = radius * Direction(angle), .heading = angle + 0.25 * kTurn, .curvature = 1.0 / radius};
}

Path RingArc(double radius, double from, double to) {
  const double angle = to - from;
  std::vector<PathPoint> points;
  const int n = std::max(4, static_cast<int>(angle * radius / 0.4));
  for (int i = 0; i <= n; ++i) points.push_back(OnRing(radius, from + angle * i / n));
  return Path(points);
}

}  // namespace

Place Roundabout(Random& random) {
  Place place;
  place.layout = "roundabout";
  const int arms = random.Integer(3, 5);
  const double radius = arms == 5 ? random.Uniform(18.0, 23.0) : random.Uniform(13.0, 20.0);
  const double width = 4.2;  // of the ring, metres
  RoadSpec spec;
  spec.lane_width = random.Uniform(3.3, 3.6);
  spec.median = random.Uniform(2.5, 4.0);
  spec.speed_limit = random.Uniform(9.0, 13.9);
  const double start = radius + random.Uniform(10.0, 13.0);
  const double delta = std::min(0.42 * kTurn / arms, (0.5 * spec.median + 7.5) / radius);

  std::vector<Road> roads;
  std::vector<double> headings;
  for (int i = 0; i < arms; ++i) {
    const double heading = kTurn * i / arms + random.Uniform(-0.08, 0.08);
    headings.push_back(heading);
    PathPen pen({.p = start * Direction(heading), .heading = heading});
    const double bend = random.Chance(0.4) ? random.Uniform(-0.006, 0.006) : 0.0;
    pen.Straight(25.0).Clothoid(25.0, 0.0, bend).Clothoid(random.Uniform(12.0, 25.0), bend, bend);
    roads.push_back(AddRoad(place, pen.Done(), spec));
  }
  // Parts of the ring, counter-clockwise: past each arm, then on to the next arm.
  std::vector<int> past;
  std::vector<int> onward;
  const auto add_ring = [&](double from, double to) {
    Lane lane;
    lane.path = RingArc(radius, from, to);
    lane.width = width;
    lane.speed_limit = 8.5;
    lane.kind = LaneKind::kRing;
    lane.movement = Movement::kRoundabout;
    return place.graph.Add(std::move(lane));
  };
  for (int i = 0; i < arms; ++i) {
    past.push_back(add_ring(headings[i] - delta, headings[i] + delta));
    const double next = i + 1 < arms ? headings[i + 1] : headings[0] + kTurn;
    onward.push_back(add_ring(headings[i] + delta, next - delta));
  }
  for (int i = 0; i < arms; ++i) {
    std::vector<Lane>& lanes = place.graph.lanes;
    lanes[past[i]].next = {{.lane = onward[i]}};
    Lane in;
    const Path& before = lanes[roads[i].backward[0]].path;
    in.path = ConnectPoses(before.At(before.length()), OnRing(radius, headings[i] + delta));
    in.speed_limit = 8.0;
    in.kind = LaneKind::kConnector;
    in.movement = Movement::kRoundabout;
    in.next = {{.lane = onward[i]}};
    in.gate = Gate{.kind = GateKind::kYield};
    const int entry = place.graph.Add(std::move(in));
    place.graph.lanes[roads[i].backward[0]].next = {{.lane = entry}};

    Lane out;
    out.path = ConnectPoses(OnRing(radius, headings[i] - delta),
                            place.graph.lanes[roads[i].forward[0]].path.At(0.0));
    out.speed_limit = 8.0;
    out.kind = LaneKind::kConnector;
    out.movement = Movement::kRoundabout;
    out.next = {{.lane = roads[i].forward[0]}};
    const int exit = place.graph.Add(std::move(out));
    place.graph.lanes[onward[(i + arms - 1) % arms]].next = {{.lane = past[i], .weight = 0.55},
                                                             {.lane = exit, .weight = 0.45}};
    const PathPoint at = roads[i].reference.At(0.0);
    const Vec2 left = Left(Direction(at.heading));
    place.decorations.push_back(
        {DecorationKind::kStopLine,
         {at.p + 0.5 * spec.median * left, at.p + roads[i].left_edge() * left}});
  }
  // Kerbs: the island, and between the arms.
  AddLine(place, DecorationKind::kRoadEdge, RingArc(radius - 0.5 * width, 0.0, kTurn));
  for (int i = 0; i < arms; ++i) {
    const Road& a = roads[i];
    const Road& b = roads[(i + 1) % arms];
    const double next = i + 1 < arms ? headings[i + 1] : headings[0] + kTurn;
    const double rim = radius + 0.5 * width;
    const Path in = a.reference.Offset(a.left_edge()).Reversed();
    const Path out = b.reference.Offset(b.right_edge());
    const double from = headings[i] + delta;
    const double to = next - delta;
    const Path arc = to - from > 0.05 ? RingArc(rim, from, to) : RingArc(rim, to - 0.02, to);
    AddLine(place, DecorationKind::kRoadEdge, ConnectPoses(in.At(in.length()), arc.At(0.0)));
    AddLine(place, DecorationKind::kRoadEdge, arc);
    AddLine(place, DecorationKind::kRoadEdge, ConnectPoses(arc.At(arc.length()), out.At(0.0)));
  }
  place.walkers = random.Integer(4, 8);
  place.initial_vehicles = random.Integer(8, 14);
  place.sensed_radius = random.Uniform(52.0, 65.0);
  AddSources(place, random, 6.5, 13.0);
  return place;
}

}  // namespace maneuver::data::town
