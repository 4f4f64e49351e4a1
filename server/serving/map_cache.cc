#include "server/serving/map_cache.h"

#include <algorithm>
#include <bit>
#include <iterator>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/files/digest.h"
#include "server/errors/error_details.h"

namespace maneuver::serving {
namespace {

static_assert(std::endian::native == std::endian::little, "MapId feeds numbers as they lie");

constexpr int32_t kDeclaresLinks = 1 << 30;  // added to the type of a feature in its digest

template <typename Number>
void Feed(files::Sha256& digest, const Number* numbers, size_t count) {
  digest.Update({reinterpret_cast<const char*>(numbers), count * sizeof(Number)});
}

monitoring::Counter& LookupCounter(monitoring::MetricRegistry& registry, const char* result) {
  return registry.AddCounter("maneuver_map_lookups_total",
                             "Scenarios that named a map, by whether the server held it.",
                             {{"result", result}});
}

bool DeclaresLinks(const v1::MapFeature& feature) {
  return !feature.successor_ids().empty() || !feature.left_neighbor_ids().empty() ||
         !feature.right_neighbor_ids().empty();
}

void FeedLinks(files::Sha256& digest, const v1::MapFeature& feature) {
  const auto lists = {&feature.successor_ids(), &feature.left_neighbor_ids(),
                      &feature.right_neighbor_ids()};
  for (const auto* ids : lists) {
    const auto count = static_cast<int32_t>(ids->size());
    Feed(digest, &count, 1);
  }
  for (const auto* ids : lists) Feed(digest, ids->data(), static_cast<size_t>(ids->size()));
}

}  // namespace

std::string MapId(const scene::MapFeatures& features) {
  files::Sha256 digest;
  for (const v1::MapFeature& feature : features) {
    const int64_t id = feature.id();
    const bool declares_links = DeclaresLinks(feature);
    const int32_t type = feature.type() + (declares_links ? kDeclaresLinks : 0);
    const auto points = static_cast<int32_t>(feature.x_size());
    const double speed_limit = feature.speed_limit();
    Feed(digest, &id, 1);
    Feed(digest, &type, 1);
    Feed(digest, &points, 1);
    Feed(digest, feature.x().data(), static_cast<size_t>(feature.x_size()));
    Feed(digest, feature.y().data(), static_cast<size_t>(feature.y_size()));
    Feed(digest, &speed_limit, 1);
    if (declares_links) FeedLinks(digest, feature);
  }
  return digest.Finish();
}

bool IsMapId(std::string_view text) { return files::IsSha256Hex(text); }

MapCache::Metrics::Metrics(monitoring::MetricRegistry& registry)
    : maps(registry.AddGauge("maneuver_maps", "Registered maps that are held.")),
      bytes(registry.AddGauge("maneuver_map_bytes", "Memory of the maps that are held.")),
      hits(LookupCounter(registry, "hit")),
      misses(LookupCounter(registry, "miss")),
      evicted(registry.AddCounter("maneuver_maps_evicted_total",
                                  "Registered maps that were evicted to make room for others.")) {}

MapCache::MapCache(const MapCacheOptions& options, monitoring::MetricRegistry& metrics)
    : options_(options), metrics_(metrics) {}

absl::StatusOr<MapCache::Registered> MapCache::Register(scene::MapFeatures features) {
  if (features.empty()) {
    return errors::InvalidField("map_features", "a map needs at least one feature");
  }
  if (const auto violations = scene::ValidateMap(features, options_.limits); !violations.empty()) {
    return errors::InvalidFields(violations);
  }
  std::string id = MapId(features);
  {
    const MutexLock lock(mutex_);
    if (const auto known = Use(id)) return Registered{std::move(id), known->bytes()};
  }
  const auto map = std::make_shared<const scene::RoadMap>(std::move(features));
  if (map->bytes() > options_.max_bytes) {
    return errors::WithReason(
        absl::ResourceExhaustedError(absl::StrCat(
            "the map takes ", map->bytes(), " bytes; register maps of at most ", options_.max_bytes,
            ", such as the surroundings of the road that is driven")),
        "MAP_TOO_LARGE");
  }
  std::list<Entry> evicted;  // dies after the lock is free
  const MutexLock lock(mutex_);
  // Somebody else may have registered it meanwhile.
  if (Use(id) == nullptr) {
    evicted = MakeRoom(map->bytes());
    by_use_.push_front({id, map});
    by_id_.emplace(id, by_use_.begin());
    bytes_ += map->bytes();
    metrics_.maps.Set(static_cast<double>(by_id_.size()));
    metrics_.bytes.Set(static_cast<double>(bytes_));
  }
  return Registered{std::move(id), map->bytes()};
}

std::list<MapCache::Entry> MapCache::MakeRoom(int64_t bytes) {
  std::list<Entry> evicted;
  while (!by_use_.empty() && (bytes_ + bytes > options_.max_bytes ||
                              by_id_.size() >= static_cast<size_t>(options_.max_maps))) {
    const Entry& oldest = by_use_.back();
    bytes_ -= oldest.map->bytes();
    by_id_.erase(oldest.id);
    evicted.splice(evicted.end(), by_use_, std::prev(by_use_.end()));
    metrics_.evicted.Increment();
  }
  return evicted;
}

std::shared_ptr<const scene::RoadMap> MapCache::Use(const std::string& id) {
  const auto found = by_id_.find(id);
  if (found == by_id_.end()) return nullptr;
  by_use_.splice(by_use_.begin(), by_use_, found->second);
  return found->second->map;
}

std::shared_ptr<const scene::RoadMap> MapCache::Find(const std::string& id) {
  const MutexLock lock(mutex_);
  auto map = Use(id);
  (map != nullptr ? metrics_.hits : metrics_.misses).Increment();
  return map;
}

}  // namespace maneuver::serving
