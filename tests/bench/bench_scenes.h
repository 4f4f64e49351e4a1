// Scenes to measure with: recorded ones, and the synthetic town's.

#ifndef MANEUVER_TESTS_BENCH_BENCH_SCENES_H_
#define MANEUVER_TESTS_BENCH_BENCH_SCENES_H_

#include <cstdint>
#include <filesystem>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::bench {

// As a planner sends them: nothing later than the prediction time, and for targets the vehicles in
// sight then, nearest to the first target that the recording names first, at most `targets`. Scenes
// with fewer vehicles are left out.
//
// Recordings of a dataset folder, in order, at most `most`. Errors: those of data::ForEachScenario.
absl::StatusOr<std::vector<v1::Scenario>> DatasetScenes(const std::filesystem::path& folder,
                                                        int targets, int most);
// Of the files validation.tfrecord-* in the folder that MANEUVER_REAL_DATA names; none without it.
std::vector<v1::Scenario> WaymoScenes(int targets, int most);
// Of the synthetic town of seed 1.
std::vector<v1::Scenario> TownScenes(int targets, int most);

// The same as the recordings of those files name their targets.
std::vector<v1::Scenario> WaymoRecordings();

int64_t MapPoints(const v1::Scenario& scenario);

// A request for the `actions` most probable actions of every target of the scenes.
v1::PredictRequest RequestFor(const std::vector<v1::Scenario>& scenes, int actions);

// The scene with its first `count` agents that are no targets, beside the targets, or with copies
// of them under other ids where it has not so many.
v1::Scenario WithAgents(const v1::Scenario& scene, int count);
// The scene with as many map features, from the first on and then again, as have `points` points.
v1::Scenario WithMapPoints(const v1::Scenario& scene, int64_t points);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_BENCH_SCENES_H_
