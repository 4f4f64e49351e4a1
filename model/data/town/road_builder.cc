#include "model/data/town/road_builder.h"

#include <algorithm>
#include <numbers>

namespace maneuver::data::town {
namespace {

constexpr double kBikeLane = 1.6;  // metres wide

double HalfWidth(const RoadSpec& spec, int lanes) {
  return 0.5 * spec.median + lanes * spec.lane_width + (spec.bike_lanes ? kBikeLane : 0.0) +
         spec.parking + 0.3;
}

int AddLane(Place& place, Path path, const RoadSpec& spec, LaneKind kind) {
  Lane lane;
  const double length = path.length();
  lane.path = std::move(path);
  lane.width = kind == LaneKind::kBike ? kBikeLane : spec.lane_width;
  lane.speed_limit = kind == LaneKind::kBike ? 5.5 : spec.speed_limit;
  lane.kind = kind;
  lane.change_from = 3.0;
  lane.change_to = std::max(0.0, length - spec.no_change_before_end);
  return place.graph.Add(std::move(lane));
}

void MakeNeighbours(Place& place, const std::vector<int>& lanes) {
  for (size_t i = 0; i + 1 < lanes.size(); ++i) {
    place.graph.lanes[lanes[i]].right = lanes[i + 1];
    place.graph.lanes[lanes[i + 1]].left = lanes[i];
  }
}

void PaintRoad(Place& place, const Road& road) {
  const RoadSpec& spec = road.spec;
  const double middle = 0.5 * spec.median;
  if (spec.kerbs) {
    AddLine(place, DecorationKind::kRoadEdge, road.reference.Offset(road.right_edge()));
    AddLine(place, DecorationKind::kRoadEdge, road.reference.Offset(road.left_edge()));
  }
  if (!spec.painted) return;
  if (spec.forward > 0 && spec.backward > 0) {
    if (spec.median >= 1.0) {
      AddLine(place, DecorationKind::kRoadEdge, road.reference.Offset(middle - 0.3));
      AddLine(place, DecorationKind::kRoadEdge, road.reference.Offset(-middle + 0.3));
    } else {
      AddLine(place, DecorationKind::kRoadLine, road.reference);
    }
  }
  const int bike = spec.bike_lanes ? 1 : 0;
  for (int i = 1; i < spec.forward + bike; ++i) {
    AddLine(place, DecorationKind::kRoadLine, road.reference.Offset(-middle - i * spec.lane_width));
  }
  for (int i = 1; i < spec.backward + bike; ++i) {
    AddLine(place, DecorationKind::kRoadLine, road.reference.Offset(middle + i * spec.lane_width));
  }
}

std::vector<Vec2> Thinned(const Path& path) {
  double turned = 0.0;
  for (const PathPoint& point : path.points()) turned = std::max(turned, std::abs(point.curvature));
  const double step = turned > 0.02 ? 1.5 : 4.0;
  const int n = std::max(1, static_cast<int>(std::ceil(path.length() / step)));
  std::vector<Vec2> points;
  for (int i = 0; i <= n; ++i) points.push_back(path.At(path.length() * i / n).p);
  return points;
}

}  // namespace

double Road::right_edge() const { return -HalfWidth(spec, spec.forward); }
double Road::left_edge() const { return HalfWidth(spec, spec.backward); }

void AddLine(Place& place, DecorationKind kind, const Path& path) {
  place.decorations.push_back({kind, Thinned(path)});
}

void AddArea(Place& place, DecorationKind kind, const Path& path, double from, double to,
             double right, double left) {
  const int n = std::max(1, static_cast<int>(std::ceil((to - from) / 4.0)));
  Decoration area{kind, {}};
  for (int i = 0; i <= n; ++i) {
    const PathPoint at = path.At(from + (to - from) * i / n);
    area.points.push_back(at.p + right * Left(Direction(at.heading)));
  }
  for (int i = n; i >= 0; --i) {
    const PathPoint at = path.At(from + (to - from) * i / n);
    area.points.push_back(at.p + left * Left(Direction(at.heading)));
  }
  place.decorations.push_back(std::move(area));
}

void AddFootway(Place& place, const Path& path, double popularity) {
  Footway footway;
  footway.path = path;
  footway.popularity = popularity;
  place.footways.push_back(std::move(footway));
}

Path JoinPaths(std::span<const Path> paths) {
  std::vector<PathPoint> points;
  for (const Path& path : paths) {
    for (const PathPoint& point : path.points()) {
      if (!points.empty() && Norm(point.p - points.back().p) < 1e-3) continue;
      PathPoint next = point;
      if (!points.empty()) {
        next.heading = points.back().heading + WrapAngle(point.heading - points.back().heading);
      }
      points.push_back(next);
    }
  }
  return Path(points);
}

Road AddRoad(Place& place, const Path& reference, const RoadSpec& spec) {
  Road road;
  road.reference = reference;
  road.spec = spec;
  const auto centre = [&spec](int lane) {
    return 0.5 * spec.median + (lane + 0.5) * spec.lane_width;
  };
  for (int i = 0; i < spec.forward; ++i) {
    road.forward.push_back(AddLane(place, reference.Offset(-centre(i)), spec, LaneKind::kRoad));
  }
  for (int i = 0; i < spec.backward; ++i) {
    road.backward.push_back(
        AddLane(place, reference.Offset(centre(i)).Reversed(), spec, LaneKind::kRoad));
  }
  MakeNeighbours(place, road.forward);
  MakeNeighbours(place, road.backward);
  if (spec.bike_lanes) {
    const double beside = 0.5 * (kBikeLane - spec.lane_width);
    road.bike_forward =
        AddLane(place, reference.Offset(-centre(spec.forward) - beside), spec, LaneKind::kBike);
    road.bike_backward = AddLane(place, reference.Offset(centre(spec.backward) + beside).Reversed(),
                                 spec, LaneKind::kBike);
  }
  PaintRoad(place, road);
  if (spec.footways) {
    AddFootway(place, reference.Offset(road.right_edge() - kFootwayOffset), 1.0);
    AddFootway(place, reference.Offset(road.left_edge() + kFootwayOffset), 1.0);
  }
  return road;
}

void AddSources(Place& place, Random& random, double shortest, double longest) {
  const std::vector<std::vector<int>> before = place.graph.Predecessors();
  for (size_t i = 0; i < place.graph.lanes.size(); ++i) {
    const LaneKind kind = place.graph.lanes[i].kind;
    if (!before[i].empty() || kind == LaneKind::kBay || place.graph.lanes[i].gate) continue;
    const double rarity = kind == LaneKind::kBike ? 3.0 : 1.0;
    place.sources.push_back({static_cast<int>(i), rarity * random.Uniform(shortest, longest)});
  }
}

}  // namespace maneuver::data::town
