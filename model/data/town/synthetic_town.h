// The synthetic town: scenes that look like driving, deterministic by seed.

#ifndef MANEUVER_MODEL_DATA_TOWN_SYNTHETIC_TOWN_H_
#define MANEUVER_MODEL_DATA_TOWN_SYNTHETIC_TOWN_H_

#include <cstdint>
#include <vector>

#include "maneuver/v1/dataset.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data::town {

struct TownOptions {
  uint64_t seed = 1;
  double duration = 20.0;       // seconds of each recording
  double frame_interval = 0.1;  // seconds
};

// A recording and what its vehicles were doing.
struct TownRecording {
  // prediction_time: when most is about to happen, at least one second in and, where it can be,
  // eight before the end. Targets: up to four vehicles that move then.
  v1::Scenario scenario;
  std::vector<v1::ManeuverAnnotation> maneuvers;
};

// Recording number `index` of the town: the same for the same options and index, whatever else was
// generated. Ids are "town-<seed>-<index>". Thread-safe.
TownRecording GenerateRecording(const TownOptions& options, int index);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_SYNTHETIC_TOWN_H_
