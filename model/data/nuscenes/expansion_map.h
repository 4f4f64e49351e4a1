// Reads the files of the nuScenes map expansion, such as boston-seaport.json.

#ifndef MANEUVER_MODEL_DATA_NUSCENES_EXPANSION_MAP_H_
#define MANEUVER_MODEL_DATA_NUSCENES_EXPANSION_MAP_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

struct ExpansionMap {
  std::vector<v1::MapFeature> features;
  // Links of connectivity to lanes that the file lacks. The published maps have some.
  int64_t open_links = 0;
  // Lanes that are left out because they have no path, or a damaged one.
  int64_t pathless_lanes = 0;
};

// Reads a map in the frame of its place, metres. Imports
//   - lane and lane_connector as centrelines, from their arcline_path_3, one point each metre; a
//     lane of type BIKE becomes a bike lane. Ids count lanes, then connectors, from 1;
//   - connectivity as successors, whichever of the two lanes declares it;
//   - neighbours. The format declares none, but a lane names the nodes of the dividers on its left
//     and on its right. Two lanes that share two nodes or more, one on its left and the other on
//     its right, are neighbours of one direction;
//   - lane_divider and road_divider as road lines. A lane divider with only NIL segments is not
//     painted, and is left out;
//   - ped_crossing as crosswalks;
//   - stop_line as stop lines. The format has an area, whose closed outline becomes the line;
//   - drivable_area as road edges: outlines and holes, without edges that two areas share. A piece
//     ends at the first node at or beyond 50 m.
// road_segment, road_block, walkway, carpark_area and traffic_light are not read: a scenario has no
// place for the first four, and the last says where lights are, never what they show.
//
//   damaged: called for each row that cannot be used: a field is missing or wrong, or names a node,
//   line, polygon or path that does not exist, or a path is longer than 5 km or makes all together
//   longer than 5,000 km, or lines and areas have more than ten million points. If it returns OK, the row is left out. Otherwise reading ends with its
//   status.
//   progress: called now and then with the number of bytes read so far
// Also returns NOT_FOUND if there is no file, and DATA_LOSS if it is not a map expansion.
absl::StatusOr<ExpansionMap> ReadExpansionMap(
    const std::filesystem::path& file,
    const std::function<absl::Status(const absl::Status& damage)>& damaged,
    const std::function<void(double bytes)>& progress);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_NUSCENES_EXPANSION_MAP_H_
