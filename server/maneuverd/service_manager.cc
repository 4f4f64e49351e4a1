#include "server/maneuverd/service_manager.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "absl/strings/numbers.h"

namespace maneuver {
namespace {

// The variable's value, which is removed; empty if there is none.
std::string Take(const char* variable) {
  const char* value = std::getenv(variable);
  std::string taken = value == nullptr ? "" : value;
  unsetenv(variable);
  return taken;
}

}  // namespace

ServiceManager ServiceManager::FromEnvironment() {
  std::string socket = Take("NOTIFY_SOCKET");
  const std::string period = Take("WATCHDOG_USEC");
  const std::string pid = Take("WATCHDOG_PID");
  std::optional<std::chrono::microseconds> watchdog;
  int64_t microseconds = 0;
  const bool is_meant = pid.empty() || pid == std::to_string(getpid());
  if (is_meant && absl::SimpleAtoi(period, &microseconds) && microseconds > 0) {
    watchdog = std::chrono::microseconds(microseconds);
  }
  return {std::move(socket), watchdog};
}

ServiceManager::ServiceManager(std::string socket,
                               std::optional<std::chrono::microseconds> watchdog)
    : socket_(std::move(socket)), watchdog_(watchdog) {}

ServiceManager::~ServiceManager() { EndWatch(); }

void ServiceManager::TellReady(std::function<bool()> is_alive) {
  Send("READY=1");
  if (socket_.empty() || !watchdog_) return;
  watch_ = std::thread([this, is_alive = std::move(is_alive)] { Watch(is_alive); });
}

void ServiceManager::TellStopping() { Send("STOPPING=1"); }

void ServiceManager::EndWatch() {
  stop_.Stop();
  if (watch_.joinable()) watch_.join();
}

void ServiceManager::Watch(const std::function<bool()>& is_alive) {
  do {
    if (is_alive()) Send("WATCHDOG=1");
  } while (!stop_.StoppedWithin(*watchdog_ / 2));
}

void ServiceManager::Send(std::string_view state) const {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (socket_.empty() || socket_.size() >= sizeof address.sun_path) return;
  std::memcpy(address.sun_path, socket_.data(), socket_.size());
  if (socket_.front() == '@') address.sun_path[0] = '\0';  // an abstract name
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + socket_.size());
  const int descriptor = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (descriptor < 0) return;
  // A manager that does not listen is not told: the server serves all the same.
  [[maybe_unused]] const ssize_t sent = sendto(descriptor, state.data(), state.size(), MSG_NOSIGNAL,
                                               reinterpret_cast<const sockaddr*>(&address), length);
  close(descriptor);
}

}  // namespace maneuver
