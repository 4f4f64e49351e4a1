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
  // Links to lanes that the file lacks. The published maps are pruned and have some.
  int64_t open_links = 0;
};

// Reads a map in the frame of its city, metres. A way becomes a lane centreline under its lane_id,
// with
//   - its nodes, whose height is left out;
//   - its successors, declared by either lane;
//   - its neighbours, unless they run the other way: l_neighbor_id of a lane next to oncoming
//     traffic names a lane of the other direction.
// has_traffic_control, turn_direction and is_intersection have no place in a MapFeature.
//
//   damaged: called for each way that cannot be used: it lacks a lane_id, two points, or a node that
//   it names, or has a number that is none. If the result is OK the way is left out; otherwise
//   reading ends with it.
// Also returns NOT_FOUND, and DATA_LOSS if the file is not such a map.
absl::StatusOr<VectorMap> ReadVectorMap(
    const std::filesystem::path& file,
    const std::function<absl::Status(const absl::Status& damage)>& damaged);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_ARGOVERSE_VECTOR_MAP_H_
