#include "model/data/town/sensor_model.h"

#include <algorithm>
#include <cmath>

namespace maneuver::data::town {
namespace {

// An error that drifts: a first-order autoregression with stationary deviation 1.
class Drift {
 public:
  Drift(double correlation, Random& random)
      : correlation_(correlation), value_(random.Normal(0.0, 1.0)) {}
  double Next(Random& random) {
    value_ = correlation_ * value_ +
             std::sqrt(1.0 - correlation_ * correlation_) * random.Normal(0.0, 1.0);
    return value_;
  }

 private:
  double correlation_;
  double value_;
};

}  // namespace

std::pair<size_t, size_t> LongestStay(const SensorModel& sensor, const Track& track,
                                      double frame_interval) {
  const std::vector<TrackPoint>& points = track.points;
  size_t best_from = 0;
  size_t best_to = 0;
  for (size_t from = 0; from < points.size();) {
    size_t to = from;
    while (to < points.size() && Norm(points[to].p) < sensor.radius) ++to;
    if (to - from > best_to - best_from) {
      best_from = from;
      best_to = to;
    }
    from = std::max(to, from + 1);
  }
  if (static_cast<double>(best_to - best_from) * frame_interval < sensor.shortest_track) return {};
  return {best_from, best_to};
}

std::optional<Sighting> Observe(const SensorModel& sensor, const Track& track,
                                double frame_interval, Random& random) {
  const std::vector<TrackPoint>& points = track.points;
  const auto [best_from, best_to] = LongestStay(sensor, track, frame_interval);
  if (best_from == best_to) return {};
  const int frames = static_cast<int>(best_to - best_from);
  int gap_from = frames;
  int gap_to = frames;
  if (random.Chance(sensor.gap_chance)) {
    const int longest = std::max(1, static_cast<int>(sensor.longest_gap / frame_interval));
    gap_from = random.Integer(1, frames);
    gap_to = gap_from + random.Integer(1, longest);
  }
  const double correlation = std::exp(-frame_interval / sensor.correlation_time);
  Drift along(correlation, random);
  Drift across(correlation, random);
  Drift turn(correlation, random);
  Drift speed(correlation, random);
  Sighting sighting;
  for (int i = 0; i < frames; ++i) {
    TrackPoint point = points[best_from + i];
    // An object that does not move is measured again and again, so its error becomes smaller.
    const double quiet = point.speed < 0.05 ? 0.2 : 1.0;
    const Vec2 body = Direction(point.heading);
    const double noise = quiet * sensor.position_noise;
    point.p =
        point.p + noise * along.Next(random) * body + noise * across.Next(random) * Left(body);
    point.heading += quiet * sensor.heading_noise * turn.Next(random);
    const double error = quiet * sensor.velocity_noise * speed.Next(random);
    point.velocity = point.velocity + error * body;
    if (i >= gap_from && i < gap_to && i + 1 < frames) continue;
    sighting.reported.push_back(point);
  }
  sighting.first = points[best_from].time;
  sighting.last = points[best_to - 1].time;
  return sighting;
}

}  // namespace maneuver::data::town
