// Whether anybody drove into anybody.

#ifndef MANEUVER_MODEL_DATA_TOWN_BOX_OVERLAP_H_
#define MANEUVER_MODEL_DATA_TOWN_BOX_OVERLAP_H_

#include <vector>

#include "model/data/town/track.h"

namespace maneuver::data::town {

// The deepest that the boxes of two road users (pedestrians aside) ever reached into each other.
struct BoxOverlap {
  double depth = 0.0;  // metres
  int first = 0;       // ids
  int second = 0;
  double time = 0.0;  // seconds
};
BoxOverlap LargestOverlap(const std::vector<Track>& tracks);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_BOX_OVERLAP_H_
