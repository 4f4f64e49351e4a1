#include "server/serving/scheduler_metrics.h"

namespace maneuver::serving {
namespace {

monitoring::Histogram& StageHistogram(monitoring::MetricRegistry& registry, const char* stage) {
  return registry.AddHistogram(
      "maneuver_stage_duration_seconds",
      "Time a target waits in the queue, and time a batch takes in each stage: raster, vectors "
      "(history, lane paths and agents nearby), whichever the model reads, encode and describe.",
      monitoring::TimeBuckets(), {{"stage", stage}});
}

monitoring::Counter& TargetCounter(monitoring::MetricRegistry& registry, const char* outcome) {
  return registry.AddCounter("maneuver_targets_total",
                             "Targets by outcome: answered, unsound (the answer was withheld, "
                             "because the model's is invalid or its engine failed), expired, "
                             "cancelled or refused: the queue was full, the "
                             "deadline too close, or the request too large.",
                             {{"outcome", outcome}});
}

monitoring::Counter& DropCounter(monitoring::MetricRegistry& registry, const char* cause,
                                 const char* after) {
  return registry.AddCounter(
      "maneuver_dropped_targets_total",
      "Targets that nobody waited for any more, by reason, and by the last stage that they passed: "
      "nothing (refused on entry), the queue, raster (the scene was read, as a raster "
      "or as vectors) or encode.",
      {{"cause", cause}, {"after", after}});
}

monitoring::Gauge& DepthGauge(monitoring::MetricRegistry& registry, const char* priority) {
  return registry.AddGauge("maneuver_queue_targets", "Targets that wait for a worker.",
                           {{"priority", priority}});
}

monitoring::Gauge& BytesGauge(monitoring::MetricRegistry& registry, const char* priority) {
  return registry.AddGauge("maneuver_queue_bytes",
                           "Bytes of the requests that have targets waiting for a worker.",
                           {{"priority", priority}});
}

}  // namespace

SchedulerMetrics::SchedulerMetrics(monitoring::MetricRegistry& registry)
    : batch_size(registry.AddHistogram("maneuver_batch_size", "Targets in a batch.",
                                       {1, 2, 4, 8, 16, 32, 64, 128})),
      queue_time(StageHistogram(registry, "queue")),
      raster_time(StageHistogram(registry, "raster")),
      vectors_time(StageHistogram(registry, "vectors")),
      encode_time(StageHistogram(registry, "encode")),
      describe_time(StageHistogram(registry, "describe")),
      queue_depth{&DepthGauge(registry, "interactive"), &DepthGauge(registry, "bulk")},
      queue_bytes{&BytesGauge(registry, "interactive"), &BytesGauge(registry, "bulk")},
      answered(TargetCounter(registry, "answered")),
      unsound(TargetCounter(registry, "unsound")),
      expired(TargetCounter(registry, "expired")),
      cancelled(TargetCounter(registry, "cancelled")),
      refused(TargetCounter(registry, "refused")) {
  constexpr std::array<const char*, kDropPlaces> kAfter = {"nothing", "queue", "raster", "encode"};
  for (size_t i = 0; i < kAfter.size(); ++i) {
    expired_after[i] = &DropCounter(registry, "expired", kAfter[i]);
    cancelled_after[i] = &DropCounter(registry, "cancelled", kAfter[i]);
  }
}

}  // namespace maneuver::serving
