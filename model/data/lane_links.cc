#include "model/data/lane_links.h"

#include <algorithm>

#include "model/scene/scenario_validation.h"

namespace maneuver::data {

void AddLaneLink(int64_t id, google::protobuf::RepeatedField<int64_t>* ids) {
  if (ids->size() < scene::ScenarioLimits().max_lane_links &&
      std::find(ids->begin(), ids->end(), id) == ids->end()) {
    ids->Add(id);
  }
}

}  // namespace maneuver::data
