// The resources that this process uses, as the kernel reports them.

#ifndef MANEUVER_SERVER_MONITORING_PROCESS_METRICS_H_
#define MANEUVER_SERVER_MONITORING_PROCESS_METRICS_H_

#include <optional>

namespace maneuver::monitoring {

// Each comment names the metric on the page, as Prometheus' client libraries do.
struct ProcessMetrics {
  double cpu_seconds = 0.0;         // process_cpu_seconds_total, user and system
  double start_time_seconds = 0.0;  // process_start_time_seconds, Unix time
  double resident_bytes = 0.0;      // process_resident_memory_bytes
  // maneuver_allocated_bytes: allocated and not freed. The rest of the resident memory is programs,
  // and freed memory that the allocator keeps.
  double allocated_bytes = 0.0;
  double virtual_bytes = 0.0;     // process_virtual_memory_bytes
  double open_descriptors = 0.0;  // process_open_fds
  double max_descriptors = 0.0;   // process_max_fds; infinity: no limit
};

// Reads the metrics of this process now. Returns nothing if /proc is missing.
std::optional<ProcessMetrics> ReadProcessMetrics();

}  // namespace maneuver::monitoring

#endif  // MANEUVER_SERVER_MONITORING_PROCESS_METRICS_H_
