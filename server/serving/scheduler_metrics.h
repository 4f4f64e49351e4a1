// Metrics of the batch scheduler.

#ifndef MANEUVER_SERVER_SERVING_SCHEDULER_METRICS_H_
#define MANEUVER_SERVER_SERVING_SCHEDULER_METRICS_H_

#include <array>

#include "server/monitoring/metrics.h"

namespace maneuver::serving {

// The last stage that work had passed when it was dropped because nobody waited for it any more.
// kRaster: the scene had been read, as a raster or as vectors.
enum class Passed { kNothing, kQueue, kRaster, kEncode };
inline constexpr int kDropPlaces = 4;

// Safe to use from any thread.
struct SchedulerMetrics {
  explicit SchedulerMetrics(monitoring::MetricRegistry& registry);

  monitoring::Histogram& batch_size;
  monitoring::Histogram& queue_time;
  monitoring::Histogram& raster_time;   // of models with a raster
  monitoring::Histogram& vectors_time;  // of models with scene vectors
  monitoring::Histogram& encode_time;
  monitoring::Histogram& describe_time;
  std::array<monitoring::Gauge*, 2> queue_depth;  // by Priority
  std::array<monitoring::Gauge*, 2> queue_bytes;
  monitoring::Counter& answered;
  monitoring::Counter& unsound;
  monitoring::Counter& expired;
  monitoring::Counter& cancelled;
  monitoring::Counter& refused;
  // By Passed.
  std::array<monitoring::Counter*, kDropPlaces> expired_after;
  std::array<monitoring::Counter*, kDropPlaces> cancelled_after;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_SCHEDULER_METRICS_H_
