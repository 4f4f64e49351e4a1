#include "model/data/town/lane_change.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace maneuver::data::town {
namespace {

double NearestOn(const Path& path, Vec2 p) {
  double best = 0.0;
  double nearest = std::numeric_limits<double>::max();
  for (double s = 0.0; s <= path.length(); s += 8.0) {
    const double distance = Norm(path.At(s).p - p);
    if (distance < nearest) {
      nearest = distance;
      best = s;
    }
  }
  return path.Project(p, best);
}

// Returns whether the lane has room around arc length `s` for `vehicle`.
bool HasGap(const Path& path, int lane, std::span<const Vehicle> vehicles, const Vehicle& vehicle,
            double s) {
  const PathPoint here = path.At(s);
  const Vec2 along = Direction(here.heading);
  for (const Vehicle& other : vehicles) {
    if (other.id == vehicle.id) continue;
    const Vec2 d = other.pose.p - here.p;
    if (Norm(d) > 90.0) continue;
    const double t = path.Project(other.pose.p, s + Dot(d, along));
    // A vehicle that is changing to this lane counts from the beginning of its change.
    if (other.lane() != lane && Norm(path.At(t).p - other.pose.p) > 2.4) continue;
    const double gap = std::abs(t - s) - 0.5 * (vehicle.length + other.length);
    if (t > s) {
      const double closing = std::max(0.0, vehicle.speed - other.speed);
      if (gap < 3.0 + 0.5 * vehicle.speed + 2.5 * closing) return false;
    } else {
      const double closing = std::max(0.0, other.speed - vehicle.speed);
      if (gap < 3.0 + 0.5 * other.speed + 3.0 * closing) return false;
    }
  }
  return true;
}

bool TryChange(const LaneNetwork& graph, std::span<const Vehicle> vehicles, bool left,
               Random& random, Vehicle& vehicle) {
  const Lane& from = graph.lanes[vehicle.lane()];
  const int target = left ? from.left : from.right;
  if (target < 0) return false;
  const Lane& to = graph.lanes[target];
  const double s = NearestOn(to.path, vehicle.pose.p);
  double length = std::max(14.0, vehicle.speed * vehicle.driver.change_time);
  if (from.ends) length = std::min(length, from.path.length() - vehicle.s + 10.0);
  if (s < 0.0 || s + length + 5.0 > to.path.length()) return false;
  if (!HasGap(to.path, target, vehicles, vehicle, s)) return false;

  const PathPoint at = to.path.At(s);
  const double offset = Dot(vehicle.pose.p - at.p, Left(Direction(at.heading)));
  std::vector<RouteStep> on = DrawRoute(graph, target, 0.0, random);
  vehicle.route.resize(vehicle.step);
  vehicle.route.insert(vehicle.route.end(), on.begin(), on.end());
  vehicle.admitted = vehicle.step;
  vehicle.s = s;
  vehicle.change_offset = 0.0;
  vehicle.change_offset = offset - LateralAt(vehicle, to, s, vehicle.travelled).offset;
  vehicle.change_start = vehicle.travelled;
  vehicle.change_length = length;
  SetPose(graph, false, vehicle);
  const Maneuver maneuver = from.ends ? Maneuver::kMerge
                            : left    ? Maneuver::kLaneChangeLeft
                                      : Maneuver::kLaneChangeRight;
  vehicle.events.push_back(
      {maneuver, vehicle.travelled, vehicle.travelled, vehicle.travelled + 0.95 * length});
  return true;
}

}  // namespace

std::vector<RouteStep> DrawRoute(const LaneNetwork& graph, int lane, double from, Random& random) {
  std::vector<RouteStep> route = {{lane, from}};
  while (route.size() < 40 && !graph.lanes[route.back().lane].next.empty()) {
    const std::vector<LaneLink>& next = graph.lanes[route.back().lane].next;
    std::vector<double> weights;
    for (const LaneLink& link : next) weights.push_back(link.weight);
    const LaneLink& link = next[random.Choose(weights)];
    route.push_back({link.lane, link.at});
  }
  return route;
}

void ConsiderLaneChange(const LaneNetwork& graph, std::span<const Vehicle> vehicles, double time,
                        double rate, double leader_gap, double leader_speed, Random& random,
                        Vehicle& vehicle) {
  const Lane& lane = graph.lanes[vehicle.lane()];
  if ((lane.left < 0 && lane.right < 0) || vehicle.changing()) return;
  if (vehicle.s < lane.change_from || vehicle.s > lane.change_to || vehicle.speed < 3.5) return;
  if (lane.ends) {
    TryChange(graph, vehicles, true, random, vehicle);
    return;
  }
  const double wish_speed = lane.speed_limit * vehicle.driver.speed_factor;
  const bool hindered = leader_gap < 12.0 + 1.5 * vehicle.speed && leader_speed < 0.8 * wish_speed;
  if (hindered && time > vehicle.wishes_at - 0.5 / rate && lane.left >= 0) {
    if (TryChange(graph, vehicles, true, random, vehicle)) {
      vehicle.wishes_at = time + 4.0 + random.Exponential(1.0 / rate);
      return;
    }
  }
  if (time < vehicle.wishes_at) return;
  const bool both = lane.left >= 0 && lane.right >= 0;
  const bool left = both ? random.Chance(0.5) : lane.left >= 0;
  const bool done = TryChange(graph, vehicles, left, random, vehicle);
  vehicle.wishes_at = time + (done ? 4.0 + random.Exponential(1.0 / rate) : 0.5);
}

}  // namespace maneuver::data::town
