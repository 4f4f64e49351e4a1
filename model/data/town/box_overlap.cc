#include "model/data/town/box_overlap.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace maneuver::data::town {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Returns how deep box b reaches into box a, along the axes of both (separating axes); <= 0 if
// apart.
double Penetration(const Track& a, const TrackPoint& pa, const Track& b, const TrackPoint& pb) {
  const Vec2 d = pb.p - pa.p;
  double depth = kInfinity;
  for (const double heading : {pa.heading, pb.heading}) {
    for (const double turn : {0.0, 0.5 * std::numbers::pi}) {
      const Vec2 axis = Direction(heading + turn);
      const auto half = [&axis](const Track& track, double angle) {
        const Vec2 body = Direction(angle);
        return 0.5 * track.length * std::abs(Dot(body, axis)) +
               0.5 * track.width * std::abs(Cross(body, axis));
      };
      depth = std::min(depth, half(a, pa.heading) + half(b, pb.heading) - std::abs(Dot(d, axis)));
    }
  }
  return depth;
}

}  // namespace

BoxOverlap LargestOverlap(const std::vector<Track>& tracks) {
  BoxOverlap largest;
  for (size_t i = 0; i < tracks.size(); ++i) {
    if (tracks[i].kind == RoadUser::kPedestrian) continue;
    for (size_t k = i + 1; k < tracks.size(); ++k) {
      if (tracks[k].kind == RoadUser::kPedestrian) continue;
      const std::vector<TrackPoint>& a = tracks[i].points;
      const std::vector<TrackPoint>& b = tracks[k].points;
      size_t x = 0;
      size_t y = 0;
      while (x < a.size() && y < b.size()) {
        if (a[x].time < b[y].time) {
          ++x;
          continue;
        }
        if (b[y].time < a[x].time) {
          ++y;
          continue;
        }
        if (Norm(a[x].p - b[y].p) < 0.5 * (tracks[i].length + tracks[k].length) + 1.5) {
          const double depth = Penetration(tracks[i], a[x], tracks[k], b[y]);
          if (depth > largest.depth) largest = {depth, tracks[i].id, tracks[k].id, a[x].time};
        }
        ++x;
        ++y;
      }
    }
  }
  return largest;
}

}  // namespace maneuver::data::town
