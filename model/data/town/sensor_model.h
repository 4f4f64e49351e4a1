// What a sensor at the middle of a place would have reported of the tracks.

#ifndef MANEUVER_MODEL_DATA_TOWN_SENSOR_MODEL_H_
#define MANEUVER_MODEL_DATA_TOWN_SENSOR_MODEL_H_

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "model/data/town/random.h"
#include "model/data/town/track.h"

namespace maneuver::data::town {

struct SensorModel {
  double radius = 80.0;           // metres around the origin that are seen
  double position_noise = 0.05;   // deviation, metres, along each axis of the body
  double heading_noise = 0.012;   // radians
  double velocity_noise = 0.12;   // metres per second
  double correlation_time = 0.8;  // seconds over which errors persist
  double gap_chance = 0.2;        // of a track to have a gap
  double longest_gap = 0.5;       // seconds
  double shortest_track = 1.0;    // seconds; shorter sightings are dropped
};

// One sighting of a track: what was reported, and the true points it came from.
struct Sighting {
  std::vector<TrackPoint> reported;
  double first = 0.0;  // seconds
  double last = 0.0;
};

// The frames [first, second) of the longest stay of a track within the radius; empty if too short.
std::pair<size_t, size_t> LongestStay(const SensorModel& sensor, const Track& track,
                                      double frame_interval);

// The longest stay of a track within the radius, with noise and gaps; nothing if too short.
std::optional<Sighting> Observe(const SensorModel& sensor, const Track& track,
                                double frame_interval, Random& random);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_SENSOR_MODEL_H_
