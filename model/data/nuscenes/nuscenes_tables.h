// Reads the tables of nuScenes: the folder v1.0-mini, v1.0-trainval or v1.0-test.

#ifndef MANEUVER_MODEL_DATA_NUSCENES_NUSCENES_TABLES_H_
#define MANEUVER_MODEL_DATA_NUSCENES_NUSCENES_TABLES_H_

#include <filesystem>
#include <functional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/data/nuscenes/nuscenes_scene.h"

namespace maneuver::data {

// Returns the size of all tables that ReadNuScenes reads, bytes. NOT_FOUND if one is missing.
absl::StatusOr<double> SizeOfNuScenes(const std::filesystem::path& folder);

// Reads the scenes of a folder, in the order of scene.json. Reads log, scene, sample, category,
// attribute, instance, sample_annotation, sensor, calibrated_sensor, sample_data and ego_pose, one
// row at a time. Keeps 32 bytes of each annotation and of each pose that LIDAR_TOP names, and the
// tokens of samples, instances and those poses: some 150 MB for the 2 GB of v1.0-trainval.
//
// A fault in the rows of one scene is stored as the scene's `damage`: a field is missing or wrong,
// a token does not exist, or scene.json or instance.json states a wrong number of rows. Links from
// row to row (prev, next) are not followed.
//   damaged: called for each damaged row, and for each instance without any of the annotations that
//   it announces, that belongs to no scene. If it returns OK, the row is
//   left out. Otherwise reading ends with its status.
//   progress: called now and then with the number of bytes read so far, over all tables
// Also returns NOT_FOUND if a table is missing, and DATA_LOSS with file and byte if one is not
// JSON.
absl::StatusOr<std::vector<NuScenesScene>> ReadNuScenes(
    const std::filesystem::path& folder,
    const std::function<absl::Status(const absl::Status& damage)>& damaged,
    const std::function<void(double bytes)>& progress);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_NUSCENES_NUSCENES_TABLES_H_
