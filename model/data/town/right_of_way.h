// Decides who may pass the gate at the start of a lane. Times are in seconds.

#ifndef MANEUVER_MODEL_DATA_TOWN_RIGHT_OF_WAY_H_
#define MANEUVER_MODEL_DATA_TOWN_RIGHT_OF_WAY_H_

#include <span>

#include "model/data/town/pedestrians.h"
#include "model/data/town/place.h"
#include "model/data/town/vehicle.h"

namespace maneuver::data::town {

// The distance that a vehicle's front keeps from the line at a gate, metres.
inline constexpr double kLineGap = 0.8;

// Returns how far a vehicle's front is from where it stops for the gate at `step` of its route,
// metres.
double DistanceToGate(const LaneNetwork& graph, const Vehicle& vehicle, size_t step);

// Returns whether `vehicle` may enter the gated lane at `step` of its route: its signal is green;
// it has stopped where it must; nobody is or will be on a part of a lane that it crosses; nobody is
// on the crosswalk; and there is room behind the junction. Vehicles that were admitted are never in
// each other's way, so no decision is needed inside a junction.
bool MayEnter(const Place& place, std::span<const Vehicle> vehicles,
              std::span<const Pedestrian> walkers, const Vehicle& vehicle, size_t step,
              double time);

// Returns whether an admitted vehicle must stop after all: the light has changed and it can still
// stop.
bool MustStopAfterAll(const Place& place, const Vehicle& vehicle, size_t step, double time);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_RIGHT_OF_WAY_H_
