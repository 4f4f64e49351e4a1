// The layouts of the town's places, one family per file. Each draws its own dimensions and demand.

#ifndef MANEUVER_MODEL_DATA_TOWN_LAYOUTS_H_
#define MANEUVER_MODEL_DATA_TOWN_LAYOUTS_H_

#include <numbers>
#include <string>
#include <vector>

#include "model/data/town/place.h"
#include "model/data/town/random.h"
#include "model/data/town/road_builder.h"

namespace maneuver::data::town {

inline constexpr double kQuarter = 0.5 * std::numbers::pi;  // a quarter of a full turn, radians

// layout_road.cc
Place StraightRoad(Random& random);
Place CurvedRoad(Random& random);
// layout_crossing.cc
Place SignalCrossing(Random& random);
Place StopCrossing(Random& random);
Place TJunction(Random& random);
// layout_turnaround.cc
Place Turnaround(Random& random);
// layout_roundabout.cc
Place Roundabout(Random& random);
// layout_motorway.cc
Place Motorway(Random& random);
Place MotorwayMerge(Random& random);
// layout_car_park.cc
Place CarPark(Random& random);

// Returns one of the above, crossings more often than others, with conflicts found and sources
// added.
//   layouts: names of the layouts to draw from; empty: all
Place DrawPlace(Random& random, const std::vector<std::string>& layouts = {});
inline constexpr int kLayoutCount = 10;
// Returns the names of all layouts: "roundabout", ...
std::vector<std::string> LayoutNames();

// Parks vehicles along the right or left kerb of a road with room for parking. Each place is taken
// with probability `share`.
void ParkAlong(Place& place, const Road& road, bool right, double share, Random& random);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_LAYOUTS_H_
