// Reads the vector maps of Argoverse 1: pruned_argoverse_PIT_10314_vector_map.xml and
// pruned_argoverse_MIA_10316_vector_map.xml.

#ifndef MANEUVER_MODEL_DATA_ARGOVERSE_VECTOR_MAP_H_
#define MANEUVER_MODEL_DATA_ARGOVERSE_VECTOR_MAP_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

struct VectorMap {
  std::vector<v1::MapFeature> lanes;
  // Number of links to lanes that the file lacks. The published maps are pruned and have some.
  int64_t open_links = 0;
};

// Reads a map in the frame of its city, metres. A way becomes a lane centreline with the way's
// lane_id. It has
//   - the positions of the way's nodes, without their height;
//   - its successors: those that the lane names, and those that name it as predecessor;
//   - its neighbours, unless they run the other way: l_neighbor_id of a lane next to oncoming
//     traffic names a lane of the other direction.
// A MapFeature has no field for has_traffic_control, turn_direction and is_intersection.
//
//   damaged: called for each node or way that cannot be used: a number is missing or malformed, an
//   id is repeated, or a way has fewer than two points or names an unknown node. If it returns OK,
//   the node or way is left out. Otherwise reading ends with its status.
// NOT_FOUND if there is no file. DATA_LOSS if the file is not a vector map of Argoverse 1.
absl::StatusOr<VectorMap> ReadVectorMap(
    const std::filesystem::path& file,
    const std::function<absl::Status(const absl::Status& damage)>& damaged);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_ARGOVERSE_VECTOR_MAP_H_
