// A recording of the synthetic town, and the options that decide it.

#ifndef MANEUVER_MODEL_DATA_TOWN_TOWN_RECORDING_H_
#define MANEUVER_MODEL_DATA_TOWN_TOWN_RECORDING_H_

#include <cstdint>
#include <string>
#include <vector>

#include "maneuver/v1/dataset.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data::town {

struct TownOptions {
  uint64_t seed = 1;
  double duration = 20.0;       // seconds of each recording
  double frame_interval = 0.1;  // seconds
  // The layouts that places have, by their names in layouts.h; empty: all.
  std::vector<std::string> layouts = {};
};

// A recording, and what its vehicles do in it.
struct TownRecording {
  // prediction_time is when most vehicles are about to act: at least one second after the start
  // and, if possible, eight before the end. The targets are up to four vehicles that move then.
  v1::Scenario scenario;
  std::vector<v1::ManeuverAnnotation> maneuvers;
};

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_TOWN_RECORDING_H_
