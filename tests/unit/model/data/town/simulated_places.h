// The places that several tests share, simulated once.

#ifndef MANEUVER_TESTS_UNIT_MODEL_DATA_TOWN_SIMULATED_PLACES_H_
#define MANEUVER_TESTS_UNIT_MODEL_DATA_TOWN_SIMULATED_PLACES_H_

#include <vector>

#include "model/data/town/simulated_place.h"

namespace maneuver::data::town {

inline constexpr int kPlaces = 40;

inline const std::vector<SimulatedPlace>& SimulatedPlaces() {
  static const auto* const kSimulated = [] {
    auto* places = new std::vector<SimulatedPlace>;
    for (int index = 0; index < kPlaces; ++index) {
      places->push_back(SimulatePlace({.seed = 7}, index));
    }
    return places;
  }();
  return *kSimulated;
}

}  // namespace maneuver::data::town

#endif  // MANEUVER_TESTS_UNIT_MODEL_DATA_TOWN_SIMULATED_PLACES_H_
