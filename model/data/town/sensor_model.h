// Simulates what a sensor at the middle of a place reports about tracks. The noise of a road user
// at rest is a fifth of that of others.

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
  double radius = 80.0;           // metres around the origin
  double position_noise = 0.05;   // standard deviation, metres, along each axis of the body
  double heading_noise = 0.012;   // radians
  double velocity_noise = 0.12;   // metres per second
  double correlation_time = 0.8;  // seconds over which errors persist
  double gap_chance = 0.2;        // probability that a track has a gap
  double longest_gap = 0.5;       // seconds
  double shortest_track = 1.0;    // seconds; shorter sightings are dropped
};

// One sighting of a track: the reported points, and the time they span.
struct Sighting {
  std::vector<TrackPoint> reported;
  double first = 0.0;  // seconds
  double last = 0.0;
};

// Returns the frames [first, second) of a track's longest stay within the radius; empty if too
// short.
std::pair<size_t, size_t> LongestStay(const SensorModel& sensor, const Track& track,
                                      double frame_interval);

// Observes the longest stay of a track within the radius, with noise and gaps. Returns nothing if
// it is too short.
std::optional<Sighting> Observe(const SensorModel& sensor, const Track& track,
                                double frame_interval, Random& random);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_SENSOR_MODEL_H_
