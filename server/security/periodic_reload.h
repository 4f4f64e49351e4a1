// Checks files for changes at regular intervals.

#ifndef MANEUVER_SERVER_SECURITY_PERIODIC_RELOAD_H_
#define MANEUVER_SERVER_SECURITY_PERIODIC_RELOAD_H_

#include <chrono>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "absl/status/statusor.h"
#include "locks/stop_latch.h"

namespace maneuver::security {

// Files to check. `reload` reads them again if they have changed, and returns whether it did.
// Changes are logged. An error is logged once, until a check succeeds or another error follows.
struct ReloadedFiles {
  std::string what;  // for the log: "certificates"
  std::function<absl::StatusOr<bool>()> reload;
};

// Calls each `reload` once every `interval` on its own thread, until it is destroyed. The first
// call comes after one interval.
class PeriodicReload {
 public:
  PeriodicReload(std::vector<ReloadedFiles> files, std::chrono::milliseconds interval);
  ~PeriodicReload();
  PeriodicReload(const PeriodicReload&) = delete;
  PeriodicReload& operator=(const PeriodicReload&) = delete;

 private:
  void Run(std::vector<ReloadedFiles> files, std::chrono::milliseconds interval);

  StopLatch stop_;
  std::thread thread_;
};

}  // namespace maneuver::security

#endif  // MANEUVER_SERVER_SECURITY_PERIODIC_RELOAD_H_
