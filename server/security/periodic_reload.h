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

// What to check. `reload` returns whether something changed. Changes are logged, and each error
// once.
struct ReloadedFiles {
  std::string what;  // "certificates"
  std::function<absl::StatusOr<bool>()> reload;
};

// Checks every `interval`, on a thread of its own, until it is destroyed.
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
