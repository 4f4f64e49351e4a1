#include "model/data/town/simulated_place.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "model/data/town/box_overlap.h"
#include "model/data/town/layouts.h"
#include "model/data/town/random.h"
#include "model/data/town/sensor_model.h"
#include "model/data/town/traffic.h"

namespace maneuver::data::town {
namespace {

constexpr uint64_t kPlaceStream = 1;  // of random numbers, apart from the sensor's
constexpr int kAttempts = 12;

}  // namespace

SimulatedPlace SimulatePlace(const TownOptions& options, int index) {
  SimulatedPlace best;
  double least = 1e9;  // overlap, plus a metre for each agent that is missing
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    Random random(options.seed, static_cast<uint64_t>(index), kPlaceStream + 16 * attempt);
    SimulatedPlace drawn;
    drawn.place = DrawPlace(random, options.layouts);
    TrafficOptions traffic;
    traffic.duration = options.duration;
    traffic.frame_interval = options.frame_interval;
    drawn.tracks = SimulateTraffic(drawn.place, traffic, random);
    SensorModel sensor;
    sensor.radius = drawn.place.sensed_radius;
    const auto seen =
        std::count_if(drawn.tracks.begin(), drawn.tracks.end(), [&](const Track& track) {
          const auto [from, to] = LongestStay(sensor, track, options.frame_interval);
          return from < to;
        });
    const double missing = std::max(0.0, kFewestAgents - static_cast<double>(seen));
    const double fault = LargestOverlap(drawn.tracks).depth + missing;
    if (fault < least) {
      least = fault;
      best = std::move(drawn);
    }
    if (least <= kOverlapTolerance) break;
  }
  return best;
}

}  // namespace maneuver::data::town
