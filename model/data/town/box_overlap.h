// Measures how deep road users drove into each other.

#ifndef MANEUVER_MODEL_DATA_TOWN_BOX_OVERLAP_H_
#define MANEUVER_MODEL_DATA_TOWN_BOX_OVERLAP_H_

#include <vector>

#include "model/data/town/track.h"

namespace maneuver::data::town {

// The greatest depth by which the boxes of two road users, not pedestrians, overlapped.
struct BoxOverlap {
  double depth = 0.0;  // metres
  int first = 0;       // ids of the two
  int second = 0;
  double time = 0.0;  // seconds
};
BoxOverlap LargestOverlap(const std::vector<Track>& tracks);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_BOX_OVERLAP_H_
