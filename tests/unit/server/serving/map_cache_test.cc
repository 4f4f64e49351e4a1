#include "server/serving/map_cache.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <thread>

#include "server/errors/error_details.h"
#include "server/monitoring/prometheus_metrics.h"

namespace maneuver::serving::map_cache_test {
namespace {

using ::testing::HasSubstr;

// A straight lane of some points.
scene::MapFeatures Lane(double y, int points = 2) {
  scene::MapFeatures features;
  v1::MapFeature* lane = features.Add();
  lane->set_id(1);
  lane->set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  for (int i = 0; i < points; ++i) {
    lane->add_x(i);
    lane->add_y(y);
  }
  return features;
}

class MapCacheTest : public ::testing::Test {
 protected:
  std::string Register(MapCache& cache, scene::MapFeatures features) {
    const auto registered = cache.Register(std::move(features));
    EXPECT_TRUE(registered.ok()) << registered.status();
    return registered.ok() ? registered->id : "";
  }

  const std::unique_ptr<monitoring::PrometheusMetrics> metrics_ =
      monitoring::PrometheusMetrics::Create();
};

// The digest is of Python's struct.pack("<qii...") and hashlib.
TEST_F(MapCacheTest, TheIdIsTheDigestThatTheContractDefines) {
  scene::MapFeatures features;
  v1::MapFeature* lane = features.Add();
  lane->set_id(7);
  lane->set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  lane->add_x(1.5);
  lane->add_x(-2.25);
  lane->add_y(3.0);
  lane->add_y(1e6);
  lane->set_speed_limit(13.9);
  v1::MapFeature* sign = features.Add();
  sign->set_id(-8);
  sign->set_type(v1::MAP_FEATURE_TYPE_STOP_SIGN);
  sign->add_x(0.0);
  sign->add_y(4.0);
  const std::string id = "fddda314254e389a748738df04628a06e5bdb13206e67e4611f21fe26f0008bf";
  EXPECT_EQ(MapId(features), id);
  EXPECT_TRUE(IsMapId(id));
  EXPECT_FALSE(IsMapId(id.substr(1)));
  EXPECT_FALSE(IsMapId("../" + id.substr(3)));
  EXPECT_FALSE(IsMapId("F" + id.substr(1)));
}

// As above; the type has 2^30 added, and three counts and three ids follow the speed limit.
TEST_F(MapCacheTest, TheIdCoversWhatALaneDeclares) {
  scene::MapFeatures features;
  v1::MapFeature* lane = features.Add();
  lane->set_id(7);
  lane->set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  lane->add_x(1.5);
  lane->add_x(-2.25);
  lane->add_y(3.0);
  lane->add_y(1e6);
  lane->set_speed_limit(13.9);
  lane->add_successor_ids(8);
  lane->add_successor_ids(-9);
  lane->add_right_neighbor_ids(10);
  v1::MapFeature* sign = features.Add();
  sign->set_id(-8);
  sign->set_type(v1::MAP_FEATURE_TYPE_STOP_SIGN);
  sign->add_x(0.0);
  sign->add_y(4.0);
  EXPECT_EQ(MapId(features), "6a83a519151d3e824f220d1ecabb826b6516e1ea28b97f8fc0cdb40a315f67f9");
}

TEST_F(MapCacheTest, EveryFieldOfAMapChangesItsId) {
  const std::string id = MapId(Lane(1.0));
  EXPECT_EQ(MapId(Lane(1.0)), id);
  const auto changed = [&](const std::function<void(v1::MapFeature*)>& change) {
    scene::MapFeatures features = Lane(1.0);
    change(features.Mutable(0));
    return MapId(features) != id;
  };
  EXPECT_TRUE(changed([](auto* lane) { lane->set_id(2); }));
  EXPECT_TRUE(changed([](auto* lane) { lane->set_type(v1::MAP_FEATURE_TYPE_BIKE_LANE); }));
  EXPECT_TRUE(changed([](auto* lane) { lane->set_x(1, 1.0 + 1e-12); }));
  EXPECT_TRUE(changed([](auto* lane) { lane->set_y(0, 1.1); }));
  EXPECT_TRUE(changed([](auto* lane) { lane->set_speed_limit(1.0); }));
  EXPECT_TRUE(changed([](auto* lane) { lane->add_successor_ids(0); }));
  EXPECT_TRUE(changed([](auto* lane) { lane->add_left_neighbor_ids(0); }));
  EXPECT_TRUE(changed([](auto* lane) { lane->add_right_neighbor_ids(0); }));
  EXPECT_TRUE(changed([](auto* lane) {
    lane->add_x(2.0);
    lane->add_y(1.0);
  }));
}

TEST_F(MapCacheTest, FindsARegisteredMapAndHoldsItOnce) {
  MapCache cache({}, *metrics_);
  const std::string id = Register(cache, Lane(1.0));
  EXPECT_EQ(Register(cache, Lane(1.0)), id);
  ASSERT_NE(cache.Find(id), nullptr);
  EXPECT_EQ(cache.Find(id)->features()[0].y(0), 1.0);
  EXPECT_EQ(cache.Find(MapId(Lane(2.0))), nullptr);
  const std::string page = metrics_->Page();
  EXPECT_THAT(page, HasSubstr("maneuver_maps 1\n"));
  EXPECT_THAT(page, HasSubstr("maneuver_map_bytes " + std::to_string(cache.Find(id)->bytes())));
  EXPECT_THAT(page, HasSubstr("maneuver_map_lookups_total{result=\"hit\"} 2\n"));
  EXPECT_THAT(page, HasSubstr("maneuver_map_lookups_total{result=\"miss\"} 1\n"));
}

TEST_F(MapCacheTest, EvictsTheLeastRecentlyUsedMap) {
  MapCache cache({.max_maps = 3}, *metrics_);
  const std::string a = Register(cache, Lane(1.0));
  const std::string b = Register(cache, Lane(2.0));
  const std::string c = Register(cache, Lane(3.0));
  EXPECT_NE(cache.Find(a), nullptr);
  EXPECT_EQ(Register(cache, Lane(2.0)), b);  // as good as a use
  const std::string d = Register(cache, Lane(4.0));
  EXPECT_EQ(cache.Find(c), nullptr);
  for (const std::string& id : {a, b, d}) EXPECT_NE(cache.Find(id), nullptr);
  EXPECT_THAT(metrics_->Page(), HasSubstr("maneuver_maps_evicted_total 1\n"));
}

TEST_F(MapCacheTest, BoundsItsBytesAndKeepsMapsInUseValid) {
  const int64_t each = scene::RoadMap(Lane(0.0, 1000)).bytes();
  MapCache cache({.max_bytes = 3 * each + each / 2}, *metrics_);
  const std::string first = Register(cache, Lane(0.0, 1000));
  const auto in_use = cache.Find(first);
  for (int i = 1; i <= 3; ++i) Register(cache, Lane(i, 1000));
  EXPECT_EQ(cache.Find(first), nullptr);
  EXPECT_THAT(metrics_->Page(), HasSubstr("maneuver_maps 3\n"));
  EXPECT_THAT(metrics_->Page(), HasSubstr("maneuver_map_bytes " + std::to_string(3 * each)));
  EXPECT_EQ(in_use->features()[0].x(999), 999.0);

  const auto too_large = cache.Register(Lane(9.0, 10'000));
  EXPECT_TRUE(absl::IsResourceExhausted(too_large.status()));
  EXPECT_EQ(errors::ReasonOf(too_large.status()), "MAP_TOO_LARGE");
  EXPECT_THAT(metrics_->Page(), HasSubstr("maneuver_maps 3\n"));
}

TEST_F(MapCacheTest, RefusesAnInvalidMapAndNamesTheField) {
  MapCache cache({.limits = {.max_map_points = 10}}, *metrics_);
  EXPECT_TRUE(absl::IsInvalidArgument(cache.Register({}).status()));
  EXPECT_THAT(std::string(cache.Register(Lane(0.0, 11)).status().message()),
              HasSubstr("11 points in all; at most 10"));
  scene::MapFeatures bad = Lane(0.0);
  bad.Mutable(0)->set_y(1, std::numeric_limits<double>::quiet_NaN());
  EXPECT_THAT(std::string(cache.Register(bad).status().message()),
              HasSubstr("map_features[0].y[1]"));
}

TEST_F(MapCacheTest, ManyThreadsRegisterAndFindAtOnce) {
  MapCache cache({.max_maps = 4}, *metrics_);
  const auto work = [&](int seed) {
    for (int i = 0; i < 300; ++i) {
      const double y = (seed + i * 7) % 6;
      const std::string id = Register(cache, Lane(y));
      if (const auto map = cache.Find(id)) {
        EXPECT_EQ(map->features()[0].y(0), y);
      }
    }
  };
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) threads.emplace_back(work, i);
  for (std::thread& thread : threads) thread.join();
  int held = 0;
  for (int y = 0; y < 6; ++y) held += cache.Find(MapId(Lane(y))) != nullptr;
  EXPECT_EQ(held, 4);
}

}  // namespace
}  // namespace maneuver::serving::map_cache_test
