// Measures what registered maps save on real scenes, in bytes and in time, beside the same scenes
// with their maps. Both are measured in turn in one run, so that their ratio holds even on a busy
// machine. MANEUVER_REAL_DATA names a folder with waymo_open_motion's validation.tfrecord-*.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "client/observed_scenario.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "model/scene/observation_window.h"
#include "model/scene/scenario_validation.h"
#include "model/scene/scene_reader.h"
#include "model/scene/target_frame.h"
#include "tests/bench/bench_model.h"
#include "tests/bench/bench_scenes.h"

namespace maneuver::bench {
namespace {

using Clock = std::chrono::steady_clock;

// A planner's request for one scene, with the map and with the map's id.
struct Scene {
  v1::PredictRequest whole;
  v1::PredictRequest named;
  scene::RoadMap map;
};

std::vector<Scene> RealScenes() {
  std::vector<Scene> scenes;
  for (v1::Scenario& scenario : WaymoRecordings()) {
    client::StripFuture(&scenario);
    Scene scene{{}, {}, scene::RoadMap(scenario.map_features())};
    *scene.whole.add_scenarios() = scenario;
    scenario.clear_map_features();
    scenario.set_map_id(std::string(64, 'a'));
    *scene.named.add_scenarios() = std::move(scenario);
    scenes.push_back(std::move(scene));
  }
  return scenes;
}

// Seconds of each step of one request.
struct Times {
  double serialize = 0.0;  // by the caller
  double parse = 0.0;
  double validate = 0.0;
  double raster = 0.0;  // of all its targets

  double total() const { return serialize + parse + validate + raster; }
};

// Measures one request.
//   map: the map that the request names; nullptr: the request's own map, which the server indexes
//     once for all targets
Times Answer(const v1::PredictRequest& request, const scene::RoadMap* map, double tolerance,
             scene::SceneReader& reader, scene::SceneInputs& inputs) {
  Times times;
  Clock::time_point last = Clock::now();
  const auto lap = [&last] {
    const Clock::time_point now = Clock::now();
    const double seconds = std::chrono::duration<double>(now - last).count();
    last = now;
    return seconds;
  };
  const std::string bytes = request.SerializeAsString();
  times.serialize = lap();
  v1::PredictRequest received;
  received.ParseFromString(bytes);
  times.parse = lap();
  const v1::Scenario& scenario = received.scenarios(0);
  benchmark::DoNotOptimize(scene::ValidateScenario(scenario, {.map_by_id = true}));
  times.validate = lap();
  const double now = scenario.prediction_time();
  std::optional<scene::RoadMap> own;
  if (map == nullptr) map = &own.emplace(scene::RoadMap::Over(scenario.map_features()));
  for (const int64_t id : scenario.target_ids()) {
    const v1::Agent* agent = scene::FindAgent(scenario, id);
    if (agent == nullptr) continue;
    const auto X_WT = scene::TargetPose(*agent, now, tolerance);
    if (!X_WT) continue;
    reader.Read(scenario, *map, now, id, *X_WT, &inputs);
  }
  times.raster = lap();
  return times;
}

void NamedMaps(benchmark::State& state) {
  static const std::vector<Scene> scenes = RealScenes();
  if (scenes.empty()) return state.SkipWithError("MANEUVER_REAL_DATA has no scenes");
  const v1::ModelSpec& spec = StoredPreset("compact").manifest.spec();
  const double tolerance = scene::WindowOf(spec).tolerance();
  scene::SceneReader reader(spec);
  scene::SceneInputs inputs = reader.NewInputs();
  double whole_bytes = 0.0;
  double named_bytes = 0.0;
  for (const Scene& scene : scenes) {
    whole_bytes += static_cast<double>(scene.whole.ByteSizeLong());
    named_bytes += static_cast<double>(scene.named.ByteSizeLong());
  }
  // Keeps the best of all rounds for each scene, to leave out the effect of other processes.
  std::vector<Times> whole(scenes.size());
  std::vector<Times> named(scenes.size());
  const auto keep = [&](Times& best, const Times& times) {
    if (best.total() == 0.0 || times.total() < best.total()) best = times;
  };
  for (auto _ : state) {
    for (size_t i = 0; i < scenes.size(); ++i) {
      keep(whole[i], Answer(scenes[i].whole, nullptr, tolerance, reader, inputs));
      keep(named[i], Answer(scenes[i].named, &scenes[i].map, tolerance, reader, inputs));
    }
  }
  const auto microseconds = [&](const std::vector<Times>& times, double Times::*step) {
    double sum = 0.0;
    for (const Times& one : times) sum += one.*step;
    return 1e6 * sum / static_cast<double>(scenes.size());
  };
  const auto count = [&](const std::string& name, double whole_value, double named_value) {
    state.counters[name + "_whole"] = whole_value;
    state.counters[name + "_named"] = named_value;
    state.counters[name + "_ratio"] = whole_value / named_value;
  };
  const double number = static_cast<double>(scenes.size());
  count("bytes", whole_bytes / number, named_bytes / number);
  double totals[2] = {0.0, 0.0};
  const std::pair<const char*, double Times::*> steps[] = {{"us_serialize", &Times::serialize},
                                                           {"us_parse", &Times::parse},
                                                           {"us_validate", &Times::validate},
                                                           {"us_raster", &Times::raster}};
  for (const auto& [name, step] : steps) {
    const double with = microseconds(whole, step);
    const double without = microseconds(named, step);
    count(name, with, without);
    totals[0] += with;
    totals[1] += without;
  }
  count("us_all", totals[0], totals[1]);
}

}  // namespace

void RegisterMapBenchmarks() {
  benchmark::RegisterBenchmark("maps/real_scenes", NamedMaps)->Unit(benchmark::kMillisecond);
}

}  // namespace maneuver::bench
