// Measures the cost of lane paths on real scenes: indexing a map, and finding the paths of a
// target, over the number of map points, of lanes within reach and of agents. MANEUVER_REAL_DATA as
// in map_bench.cc.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "model/scene/lane_graph.h"
#include "model/scene/lane_paths.h"
#include "model/scene/road_map.h"
#include "model/scene/target_frame.h"
#include "tests/bench/bench_model.h"
#include "tests/bench/bench_scenes.h"

namespace maneuver::bench {
namespace {

constexpr int kScenes = 8;
constexpr int kTargets = 8;  // of a scene
constexpr double kSpeed = 12.0;

const std::vector<v1::Scenario>& Scenes() {
  static const std::vector<v1::Scenario> scenes = WaymoScenes(kTargets, kScenes);
  return scenes;
}

// A target, and the arguments for finding its paths.
struct Query {
  const v1::Scenario* scene;
  const scene::LaneGraph* lanes;
  int64_t target_id;
  scene::Pose2 X_WT;
};

struct Queries {
  std::vector<v1::Scenario> scenes;
  std::vector<scene::RoadMap> maps;
  std::vector<Query> queries;

  template <typename Change>
  explicit Queries(Change change) {
    for (const v1::Scenario& scene : Scenes()) scenes.push_back(change(scene));
    for (const v1::Scenario& scene : scenes) {
      maps.push_back(scene::RoadMap::Over(scene.map_features()));
    }
    for (size_t i = 0; i < scenes.size(); ++i) {
      for (const int64_t id : scenes[i].target_ids()) {
        const v1::Agent* const agent = scene::FindAgent(scenes[i], id);
        if (agent == nullptr) continue;
        const auto X_WT = scene::TargetPose(*agent, scenes[i].prediction_time(), 0.05);
        if (X_WT) queries.push_back({&scenes[i], &maps[i].lanes(), id, *X_WT});
      }
    }
  }
  Queries(const Queries&) = delete;
  Queries& operator=(const Queries&) = delete;
};

// Measures microseconds per target, and the number of its paths.
void Find(benchmark::State& state, const Queries& queries) {
  if (queries.queries.empty()) return state.SkipWithError("MANEUVER_REAL_DATA has no scenes");
  scene::LanePathFinder finder;
  scene::LanePathInputs inputs;
  int64_t paths = 0;
  for (auto _ : state) {
    for (const Query& query : queries.queries) {
      finder.Find(*query.scene, *query.lanes, query.scene->prediction_time(), query.target_id,
                  query.X_WT, kSpeed, {}, &inputs);
      benchmark::DoNotOptimize(inputs);
      paths += inputs.count;
    }
  }
  CountTargets(state, static_cast<int>(queries.queries.size()));
  state.counters["paths"] =
      static_cast<double>(paths) / static_cast<double>(state.iterations() * queries.queries.size());
}

void FindOverPoints(benchmark::State& state) {
  Find(state,
       Queries([&](const v1::Scenario& scene) { return WithMapPoints(scene, state.range(0)); }));
}

void FindOverCopies(benchmark::State& state) {
  Find(state, Queries([&](const v1::Scenario& scene) {
         return WithMapCopies(scene, static_cast<int>(state.range(0)));
       }));
}

void FindOverAgents(benchmark::State& state) {
  Find(state, Queries([&](const v1::Scenario& scene) {
         return WithAgents(scene, static_cast<int>(state.range(0)));
       }));
}

void IndexOverPoints(benchmark::State& state) {
  if (Scenes().empty()) return state.SkipWithError("MANEUVER_REAL_DATA has no scenes");
  std::vector<v1::Scenario> scenes;
  for (const v1::Scenario& scene : Scenes()) {
    scenes.push_back(WithMapPoints(scene, state.range(0)));
  }
  int64_t lane_points = 0;
  int64_t bytes = 0;
  for (auto _ : state) {
    for (const v1::Scenario& scene : scenes) {
      const scene::RoadMap map = scene::RoadMap::Over(scene.map_features());
      const scene::LaneGraph& lanes = map.lanes();
      for (int i = 0; i < lanes.size(); ++i) {
        benchmark::DoNotOptimize(lanes.Successors(i).size());
        lane_points += lanes.lane(i).last - lanes.lane(i).first + 1;
      }
      bytes += lanes.bytes();
    }
  }
  const double maps = static_cast<double>(state.iterations() * scenes.size());
  state.counters["lane_points"] = static_cast<double>(lane_points) / maps;
  state.counters["bytes"] = static_cast<double>(bytes) / maps;
  state.counters["us_a_map"] =
      benchmark::Counter(1e-6 * maps, benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

}  // namespace

void RegisterLanePathBenchmarks() {
  const auto add = [](const char* name, void (*run)(benchmark::State&),
                      const std::vector<int64_t>& sizes) {
    auto* const added = benchmark::RegisterBenchmark(name, run)->Unit(benchmark::kMicrosecond);
    for (const int64_t size : sizes) added->Arg(size);
  };
  const std::vector<int64_t> points = {1'000, 2'500, 5'000, 10'000, 20'000, 40'000, 80'000};
  add("lane_paths/index_over_map_points", IndexOverPoints, points);
  add("lane_paths/find_over_map_points", FindOverPoints, points);
  add("lane_paths/find_over_map_copies", FindOverCopies, {1, 2, 4, 8, 16});
  add("lane_paths/find_over_agents", FindOverAgents, {0, 50, 100, 200, 400});
}

}  // namespace maneuver::bench
