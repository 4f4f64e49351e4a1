#include "model/data/town/leader.h"

#include <algorithm>
#include <cmath>

namespace maneuver::data::town {
namespace {

// Checks whether a disc is in the way on the path ahead.
void MeetDisc(std::span<const AheadPoint> ahead, double half_length, double half_width, Vec2 centre,
              double radius, Vec2 velocity, double margin, Leader& leader) {
  const double clearance = half_width + radius + margin;
  for (size_t i = 0; i < ahead.size(); ++i) {
    const AheadPoint& point = ahead[i];
    const Vec2 d = centre - point.p;
    // Points are two metres apart, so the next far / 2.1 points cannot touch the disc either.
    const double far = Norm(d) - clearance - 1.1;
    if (far > 2.1) i += static_cast<size_t>(far / 2.1);
    if (far > 0.0) continue;
    const double along = Dot(d, point.direction);
    if (std::abs(along) > 1.05 || std::abs(Cross(point.direction, d)) > clearance) continue;
    const double distance = point.distance + along;
    if (distance < 0.5 * half_length) return;  // beside or behind
    const double gap = std::max(0.05, distance - radius - half_length);
    if (gap < leader.gap) leader = {gap, std::max(0.0, Dot(velocity, point.direction))};
    return;
  }
}

}  // namespace

Leader FindLeader(std::span<const Vehicle> vehicles, std::span<const Pedestrian> walkers,
                  const Vehicle& vehicle) {
  const std::vector<AheadPoint>& ahead = vehicle.ahead;
  Leader leader;
  if (ahead.empty()) return leader;
  const double reach = ahead.back().distance + 12.0;
  const double half_length = 0.5 * vehicle.length;
  const double half_width = 0.5 * vehicle.width;
  for (const Vehicle& other : vehicles) {
    if (other.id == vehicle.id || Norm(other.pose.p - vehicle.pose.p) > reach) continue;
    const double radius = 0.5 * other.width;
    const double first = 0.5 * other.length - radius;
    const int discs = std::max(1, static_cast<int>(std::ceil(2.0 * first / 1.5)) + 1);
    const Vec2 body = Direction(other.body_heading);
    const Vec2 velocity = other.speed * Direction(other.pose.heading);
    for (int d = 0; d < discs; ++d) {
      const double at = discs > 1 ? -first + 2.0 * first * d / (discs - 1) : 0.0;
      MeetDisc(ahead, half_length, half_width, other.pose.p + at * body, radius, velocity, 0.25,
               leader);
    }
  }
  for (const Pedestrian& walker : walkers) {
    if (!walker.on_road || Norm(walker.p - vehicle.pose.p) > reach) continue;
    const Vec2 velocity = walker.speed * Direction(walker.heading);
    for (const double soon : {0.0, 0.7, 1.4}) {
      MeetDisc(ahead, half_length, half_width, walker.p + soon * velocity, 0.4, {}, 0.6, leader);
    }
  }
  return leader;
}

}  // namespace maneuver::data::town
