#include "model/learning/scene_source.h"

#include <atomic>
#include <thread>

#include "model/artifact/model_spec.h"

namespace maneuver::learning {

SceneSource::SceneSource(const v1::ModelSpec& spec, const ExampleSet& set, int threads)
    : set_(set), maps_(set.recordings.size()) {
  const bool reads_lanes = artifact::ReadsLanePaths(spec);
  std::atomic<size_t> next = 0;
  std::vector<std::jthread> workers;
  for (int worker = 0; worker < threads; ++worker) {
    workers.emplace_back([&] {
      for (size_t i = next++; i < maps_.size(); i = next++) {
        maps_[i].emplace(scene::RoadMap::Over(set_.recordings[i].map_features()));
        if (reads_lanes) maps_[i]->lanes();
      }
    });
  }
  workers.clear();  // waits for them
}

}  // namespace maneuver::learning
