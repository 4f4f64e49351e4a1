// Reports the server's state to systemd by the protocol of sd_notify(3).

#ifndef MANEUVER_SERVER_MANEUVERD_SERVICE_MANAGER_H_
#define MANEUVER_SERVER_MANEUVERD_SERVICE_MANAGER_H_

#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include "locks/stop_latch.h"

namespace maneuver {

// Sends a datagram for each state to the socket that NOTIFY_SOCKET names. Without that variable it
// sends nothing, and nothing fails. libsystemd would do the same at the cost of a dependency.
class ServiceManager {
 public:
  // Reads NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID, and removes them from the environment, so
  // that child processes do not see them. Call before any thread is started.
  static ServiceManager FromEnvironment();

  // Connects to the manager.
  //   socket: a path, or '@' and an abstract name; empty: nothing is sent.
  //   watchdog: systemd kills a server that is silent for this long; nothing: no watchdog.
  ServiceManager(std::string socket, std::optional<std::chrono::microseconds> watchdog);
  ServiceManager(const ServiceManager&) = delete;
  ServiceManager& operator=(const ServiceManager&) = delete;
  ~ServiceManager();

  // Reports that the server is ready. From now on sends a sign of life twice per watchdog period,
  // as long as `is_alive` returns true.
  void TellReady(std::function<bool()> is_alive);
  // Reports that the server is stopping. Signs of life continue until this object is destroyed or
  // EndWatch is called.
  void TellStopping();
  // Ends the signs of life: `is_alive` is not called any more.
  void EndWatch();

 private:
  void Send(std::string_view state) const;
  void Watch(const std::function<bool()>& is_alive);

  const std::string socket_;
  const std::optional<std::chrono::microseconds> watchdog_;
  StopLatch stop_;
  std::thread watch_;
};

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_SERVICE_MANAGER_H_
