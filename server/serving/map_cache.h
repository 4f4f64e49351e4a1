// Holds the maps that callers registered, for scenarios that name a map by its id.
//
// A map's id is the digest of its content. So equal maps have the same id, and nobody can change
// what an id stands for. The number and the memory of maps are limited; the least recently used map
// is evicted first. Scenarios in progress keep their maps.

#ifndef MANEUVER_SERVER_SERVING_MAP_CACHE_H_
#define MANEUVER_SERVER_SERVING_MAP_CACHE_H_

#include <cstdint>
#include <list>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "locks/mutex.h"
#include "model/scene/road_map.h"
#include "model/scene/scenario_validation.h"
#include "server/monitoring/metrics.h"

namespace maneuver::serving {

struct MapCacheOptions {
  int max_maps = 256;
  int64_t max_bytes = int64_t{256} << 20;  // of memory for all maps
  scene::ScenarioLimits limits = {};       // limits on a map's features
};

// Returns the RegisterMapResponse.map_id of a map, as the contract defines it.
std::string MapId(const scene::MapFeatures& features);

// Returns whether `text` has the form of a map id.
bool IsMapId(std::string_view text);

// Safe to use from any thread.
class MapCache {
 public:
  MapCache(const MapCacheOptions& options, monitoring::MetricRegistry& metrics);

  struct Registered {
    std::string id;
    int64_t bytes = 0;
  };
  // Holds the map from now on, and evicts others if there is no room.
  //   INVALID_ARGUMENT: the features are not a valid map; field paths are those of a Scenario.
  //   RESOURCE_EXHAUSTED, reason MAP_TOO_LARGE: the map alone takes more than max_bytes.
  absl::StatusOr<Registered> Register(scene::MapFeatures features);

  // Returns the map and marks it as the most recently used one; nullptr if it is not held.
  std::shared_ptr<const scene::RoadMap> Find(const std::string& id);

 private:
  struct Entry {
    std::string id;
    std::shared_ptr<const scene::RoadMap> map;
  };

  struct Metrics {
    explicit Metrics(monitoring::MetricRegistry& registry);
    monitoring::Gauge& maps;
    monitoring::Gauge& bytes;
    monitoring::Counter& hits;
    monitoring::Counter& misses;
    monitoring::Counter& evicted;
  };

  // Returns the map and marks it as the most recently used one; nullptr if it is not held.
  std::shared_ptr<const scene::RoadMap> Use(const std::string& id)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Evicts maps until `bytes` more fit. Returns the evicted maps.
  std::list<Entry> MakeRoom(int64_t bytes) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const MapCacheOptions options_;
  Metrics metrics_;
  Mutex mutex_;
  std::list<Entry> by_use_ ABSL_GUARDED_BY(mutex_);  // most recently used first
  std::unordered_map<std::string, std::list<Entry>::iterator> by_id_ ABSL_GUARDED_BY(mutex_);
  int64_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_MAP_CACHE_H_
