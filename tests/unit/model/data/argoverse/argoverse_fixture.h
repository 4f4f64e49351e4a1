// A small synthetic sequence and map in the format of Argoverse 1. No number of it comes from
// Argoverse.

#ifndef MANEUVER_TESTS_UNIT_MODEL_DATA_ARGOVERSE_ARGOVERSE_FIXTURE_H_
#define MANEUVER_TESTS_UNIT_MODEL_DATA_ARGOVERSE_ARGOVERSE_FIXTURE_H_

#include <string>

namespace maneuver::data {

// Returns a sequence of 50 times, 0.1 s apart, from `first` seconds on, in PIT:
//   "av"      AV      along y = 0 at 10 m/s from x = 0
//   "agent"   AGENT   along y = 3.5 at 8 m/s from x = 10, and slower by 1 m/s each second
//   "parked"  OTHERS  stands at (30, 7)
//   "short"   OTHERS  along x = 50 at 2 m/s from y = -20, at the first ten times alone
std::string ArgoverseSequence(double first = 315'969'904.25);

// Returns a vector map of PIT. Lanes, of two points each:
//   1  from (0, 0) to (50, 0), and 2 from there to (100, 0), which alone declares it
//   3  from (0, 3.5) to (50, 3.5), left of 1 and of its direction
//   4  from (50, 7) to (0, 7), left of 3 and against its direction
//   5  from (5000, 0) to (5050, 0), far away; its successor 1 closes a circle
// Lane 2 has 5 and 99 as successors; there is no lane 99.
std::string ArgoverseMap();

}  // namespace maneuver::data

#endif  // MANEUVER_TESTS_UNIT_MODEL_DATA_ARGOVERSE_ARGOVERSE_FIXTURE_H_
