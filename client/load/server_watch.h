// Watches a server's own metrics while it is under load.

#ifndef MANEUVER_CLIENT_LOAD_SERVER_WATCH_H_
#define MANEUVER_CLIENT_LOAD_SERVER_WATCH_H_

#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "client/load/metrics_page.h"
#include "locks/mutex.h"
#include "locks/stop_latch.h"

namespace maneuver::load {

// The highest values of gauges, which two pages alone would miss.
struct Peaks {
  std::optional<double> queued_targets = {};
  std::optional<double> memory_bytes = {};  // resident
};

struct ServerChange {
  MetricsPage before;
  MetricsPage after;
  Peaks peaks;
};

// Reads the metrics page at the start, every half second, and at the end.
class ServerWatch {
 public:
  // Reads the first page. UNAVAILABLE or INVALID_ARGUMENT as FetchMetrics.
  static absl::StatusOr<std::unique_ptr<ServerWatch>> Start(const std::string& url);
  ~ServerWatch();
  ServerWatch(const ServerWatch&) = delete;
  ServerWatch& operator=(const ServerWatch&) = delete;

  // Reads the last page, ends the watch and returns what changed. Call once. Errors as Start.
  absl::StatusOr<ServerChange> End();

 private:
  ServerWatch(const std::string& url, MetricsPage before);
  void Look(const MetricsPage& page);
  void StopLooking();

  const std::string url_;
  const MetricsPage before_;
  StopLatch end_;
  Mutex mutex_;
  Peaks peaks_ ABSL_GUARDED_BY(mutex_);
  std::thread looker_;
};

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_SERVER_WATCH_H_
