#include "model/data/town/pedestrians.h"

#include <algorithm>
#include <numbers>

namespace maneuver::data::town {
namespace {

// Returns how far a walker has walked when the road begins and when it ends, metres.
std::pair<double, double> Crossing(const Footway& footway, bool backwards) {
  if (!backwards) return {footway.crossing_from, footway.crossing_to};
  const double length = footway.path.length();
  return {length - footway.crossing_to, length - footway.crossing_from};
}

}  // namespace

Pedestrians::Pedestrians(const Place& place, Random& random, int first_id) : place_(place) {
  if (place.footways.empty()) return;
  std::vector<double> popularity;
  for (const Footway& footway : place.footways) popularity.push_back(footway.popularity);
  for (int i = 0; i < place.walkers; ++i) {
    Pedestrian walker;
    walker.id = first_id + i;
    walker.footway = random.Choose(popularity);
    walker.backwards = random.Chance(0.5);
    walker.pace = random.ClampedNormal(1.35, 0.2, 0.8, 2.0);
    walker.speed = walker.pace;
    const Footway& footway = place.footways[walker.footway];
    const auto [from, to] = Crossing(footway, walker.backwards);
    // Starts near the crossing, so that some cross during the recording, but never on the road.
    walker.s = from < to ? std::max(0.0, from - random.Uniform(1.0, 30.0))
                         : random.Uniform(0.0, footway.path.length());
    walker.offset = random.Uniform(-0.7, 0.7);
    SetPose(walker);
    walkers_.push_back(walker);
  }
}

void Pedestrians::SetPose(Pedestrian& walker) const {
  const Footway& footway = place_.footways[walker.footway];
  const double length = footway.path.length();
  PathPoint at = footway.path.At(walker.backwards ? length - walker.s : walker.s);
  if (walker.backwards) at.heading += std::numbers::pi;
  walker.p = at.p + walker.offset * Left(Direction(at.heading));
  walker.heading = at.heading;
  const auto [from, to] = Crossing(footway, walker.backwards);
  walker.on_road = walker.s > from && walker.s < to;
}

bool Pedestrians::MayCross(const Pedestrian& walker, double time,
                           std::span<const Vehicle> vehicles) const {
  const Footway& footway = place_.footways[walker.footway];
  const double needed = (footway.crossing_to - footway.crossing_from) / walker.pace + 1.0;
  if (footway.signal_group >= 0 && place_.signals.UntilGreen(footway.signal_group, time) < needed) {
    return false;
  }
  const Vec2 a = footway.path.At(footway.crossing_from).p;
  const Vec2 b = footway.path.At(footway.crossing_to).p;
  const Vec2 along = (1.0 / Norm(b - a)) * (b - a);
  for (const Vehicle& vehicle : vehicles) {
    const double soon = vehicle.speed < 0.3 ? 3.0 : 4.0 + vehicle.speed * 3.0;
    for (const AheadPoint& point : vehicle.ahead) {
      if (point.distance > soon + 0.5 * vehicle.length) break;
      const Vec2 from_a = point.p - a;
      const double beside = Dot(from_a, along);
      if (std::abs(Cross(along, from_a)) < 3.0 && beside > -1.0 && beside < Norm(b - a) + 1.0) {
        return false;
      }
    }
    // The rear of another vehicle may still be on the crosswalk.
    const Vec2 from_a = vehicle.pose.p - a;
    const double beside = Dot(from_a, along);
    if (std::abs(Cross(along, from_a)) < 0.5 * vehicle.length + 2.0 && beside > -1.0 &&
        beside < Norm(b - a) + 1.0) {
      return false;
    }
  }
  return true;
}

void Pedestrians::Step(double time, double dt, std::span<const Vehicle> vehicles) {
  for (Pedestrian& walker : walkers_) {
    const Footway& footway = place_.footways[walker.footway];
    const auto [from, to] = Crossing(footway, walker.backwards);
    double wanted = walker.pace;
    if (from < to && walker.s <= from && walker.s > from - 1.0 &&
        !MayCross(walker, time, vehicles)) {
      wanted = 0.0;
    }
    const double change = std::clamp(wanted - walker.speed, -2.5 * dt, 1.5 * dt);
    walker.speed = std::max(0.0, walker.speed + change);
    double next = walker.s + walker.speed * dt;
    // A walker who stops does not slide off the kerb.
    if (wanted == 0.0 && next > from) {
      next = walker.s;
      walker.speed = 0.0;
    }
    walker.s = next;
    SetPose(walker);
  }
  std::erase_if(walkers_, [this](const Pedestrian& walker) {
    return walker.s > place_.footways[walker.footway].path.length();
  });
}

}  // namespace maneuver::data::town
