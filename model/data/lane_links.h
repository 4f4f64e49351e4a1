// Lists of lane ids: successors and neighbours.

#ifndef MANEUVER_MODEL_DATA_LANE_LINKS_H_
#define MANEUVER_MODEL_DATA_LANE_LINKS_H_

#include <google/protobuf/repeated_field.h>

#include <cstdint>

namespace maneuver::data {

// Adds an id to a list unless the list has it already, or has as many as ScenarioLimits accepts.
void AddLaneLink(int64_t id, google::protobuf::RepeatedField<int64_t>* ids);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_LANE_LINKS_H_
