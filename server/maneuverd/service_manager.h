// Tells systemd how the server is: the protocol of sd_notify(3).

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

// A datagram for each state goes to the socket that NOTIFY_SOCKET names. Nothing is sent, and
// nothing fails, where no manager waits for it. libsystemd does the same with a dependency more.
class ServiceManager {
 public:
  // Reads NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID, and removes them from the environment:
  // they are not for the processes that this one starts. Call before any thread is started.
  static ServiceManager FromEnvironment();

  //   socket: a path, or '@' and an abstract name; empty: nobody is told anything.
  //   watchdog: a server that is silent for so long is killed; nothing: no watchdog.
  ServiceManager(std::string socket, std::optional<std::chrono::microseconds> watchdog);
  ServiceManager(const ServiceManager&) = delete;
  ServiceManager& operator=(const ServiceManager&) = delete;
  ~ServiceManager();

  // The server listens. From now on the watchdog is told, twice in its time, that the server is
  // alive, as long as `is_alive` says so.
  void TellReady(std::function<bool()> is_alive);
  // The server ends its calls. The watchdog is told as before, until this object is destroyed or
  // EndWatch is called.
  void TellStopping();
  // `is_alive` is not called any more.
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
