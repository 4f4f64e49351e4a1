// Provides scenes to measure with: recorded ones, and those of the synthetic town.

#ifndef MANEUVER_TESTS_BENCH_BENCH_SCENES_H_
#define MANEUVER_TESTS_BENCH_BENCH_SCENES_H_

#include <cstdint>
#include <filesystem>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::bench {

// These functions return scenes as a planner sends them, with nothing later than the prediction
// time. Each has `targets` targets: of the vehicles visible then, those nearest to the first target
// that the recording names. Scenes with fewer vehicles are left out.
//
// Returns at most `most` recordings of a dataset folder, in order. Errors: those of
// data::ForEachScenario.
absl::StatusOr<std::vector<v1::Scenario>> DatasetScenes(const std::filesystem::path& folder,
                                                        int targets, int most);
// Returns scenes of the files validation.tfrecord-* in the folder that MANEUVER_REAL_DATA names;
// none without it.
std::vector<v1::Scenario> WaymoScenes(int targets, int most);
// Returns scenes of the synthetic town of seed 1.
std::vector<v1::Scenario> TownScenes(int targets, int most);

// Returns the recordings of those files with the targets that they name.
std::vector<v1::Scenario> WaymoRecordings();

int64_t MapPoints(const v1::Scenario& scenario);

// Returns a request for the `actions` most probable actions of every target of the scenes.
v1::PredictRequest RequestFor(const std::vector<v1::Scenario>& scenes, int actions);

// Returns the scene with `count` agents besides its targets: the first ones, then copies of them
// under other ids.
v1::Scenario WithAgents(const v1::Scenario& scene, int count);
// Returns the scene with about `points` map points: the map features nearest to the first target,
// then copies of its map side by side.
v1::Scenario WithMapPoints(const v1::Scenario& scene, int64_t points);
// Returns the scene with `copies` of its map in one place: so many times as much lies within reach
// of each target.
v1::Scenario WithMapCopies(const v1::Scenario& scene, int copies);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_BENCH_SCENES_H_
