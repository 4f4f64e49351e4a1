// Who may pass the gate at the start of a lane.

#ifndef MANEUVER_MODEL_DATA_TOWN_RIGHT_OF_WAY_H_
#define MANEUVER_MODEL_DATA_TOWN_RIGHT_OF_WAY_H_

#include <span>

#include "model/data/town/pedestrians.h"
#include "model/data/town/place.h"
#include "model/data/town/vehicle.h"

namespace maneuver::data::town {

// Metres that the front of a vehicle keeps from the line at a gate.
inline constexpr double kLineGap = 0.8;

// Metres from a vehicle's front to where it stops for the gate at `step` of its route.
double DistanceToGate(const LaneGraph& graph, const Vehicle& vehicle, size_t step);

// Whether `vehicle` may enter the gated lane at `step` of its route: its signal is green, it has
// stopped where it must, nobody is or will be on a piece of lane that it has to cross, nobody is on
// the crosswalk, and there is room behind the junction. Those who were let in are never in each
// other's way, so nobody has to decide again inside a junction.
bool MayEnter(const Place& place, std::span<const Vehicle> vehicles,
              std::span<const Pedestrian> walkers, const Vehicle& vehicle, size_t step,
              double time);

// Whether a vehicle that was let in has to stop after all: the light has changed and it still can.
bool MustStopAfterAll(const Place& place, const Vehicle& vehicle, size_t step, double time);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_RIGHT_OF_WAY_H_
