#include "server/maneuverd/service_manager.h"

#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <string>

#include "tests/unit/temporary_folder.h"

namespace maneuver::service_manager_test {
namespace {

// The other end of the protocol, as systemd has it.
class Manager {
 public:
  //   name: a path, or '@' and an abstract name.
  explicit Manager(const std::string& name) : descriptor_(socket(AF_UNIX, SOCK_DGRAM, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    name.copy(address.sun_path, sizeof address.sun_path);
    if (name.front() == '@') address.sun_path[0] = '\0';
    const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    EXPECT_EQ(bind(descriptor_, reinterpret_cast<const sockaddr*>(&address), length), 0);
    const timeval patience{.tv_sec = 10, .tv_usec = 0};
    setsockopt(descriptor_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  }
  ~Manager() { close(descriptor_); }

  // The next state that it is told; empty after ten seconds.
  std::string Next() const {
    char bytes[256];
    const ssize_t count = recv(descriptor_, bytes, sizeof bytes, 0);
    return count < 0 ? "" : std::string(bytes, static_cast<size_t>(count));
  }
  bool HasMore() const {
    char byte = 0;
    return recv(descriptor_, &byte, 1, MSG_DONTWAIT | MSG_PEEK) >= 0;
  }

 private:
  const int descriptor_;
};

TEST(ServiceManagerTest, TellsWhenTheServerIsReadyAndWhenItStops) {
  const TemporaryFolder folder;
  const std::string path = (folder / "notify").string();
  const Manager manager(path);
  ServiceManager told(path, std::nullopt);
  EXPECT_FALSE(manager.HasMore());
  told.TellReady([] { return true; });
  EXPECT_EQ(manager.Next(), "READY=1");
  told.TellStopping();
  EXPECT_EQ(manager.Next(), "STOPPING=1");
  told.EndWatch();
  EXPECT_FALSE(manager.HasMore());  // there was no watchdog
}

TEST(ServiceManagerTest, TellsTheWatchdogWhileTheServerIsAlive) {
  const TemporaryFolder folder;
  const std::string path = (folder / "notify").string();
  const Manager manager(path);
  std::atomic<int> asked = 0;
  ServiceManager told(path, std::chrono::milliseconds(2));
  told.TellReady([&asked] { return ++asked <= 3; });
  EXPECT_EQ(manager.Next(), "READY=1");
  for (int i = 0; i < 3; ++i) EXPECT_EQ(manager.Next(), "WATCHDOG=1");
  // It goes on looking, and does not say that a server lives that does not.
  while (asked < 10) std::this_thread::yield();
  told.EndWatch();
  EXPECT_FALSE(manager.HasMore());
}

TEST(ServiceManagerTest, ReadsTheEnvironmentAndKeepsItFromChildren) {
  const std::string name = "@maneuver-test-" + std::to_string(getpid());
  const Manager manager(name);
  setenv("NOTIFY_SOCKET", name.c_str(), 1);
  setenv("WATCHDOG_USEC", "2000", 1);
  setenv("WATCHDOG_PID", std::to_string(getpid()).c_str(), 1);
  ServiceManager told = ServiceManager::FromEnvironment();
  for (const char* variable : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) {
    EXPECT_EQ(getenv(variable), nullptr) << variable;
  }
  told.TellReady([] { return true; });
  EXPECT_EQ(manager.Next(), "READY=1");
  EXPECT_EQ(manager.Next(), "WATCHDOG=1");
}

TEST(ServiceManagerTest, LeavesAWatchdogOfAnotherProcessAlone) {
  const TemporaryFolder folder;
  const std::string path = (folder / "notify").string();
  const Manager manager(path);
  setenv("NOTIFY_SOCKET", path.c_str(), 1);
  setenv("WATCHDOG_USEC", "2000", 1);
  setenv("WATCHDOG_PID", std::to_string(getppid()).c_str(), 1);
  ServiceManager told = ServiceManager::FromEnvironment();
  std::atomic<bool> asked = false;
  told.TellReady([&asked] { return asked = true; });
  EXPECT_EQ(manager.Next(), "READY=1");
  told.EndWatch();
  EXPECT_FALSE(asked);
}

TEST(ServiceManagerTest, WithoutAManagerNothingFails) {
  for (const std::string& socket :
       {std::string(), std::string("/no/such/socket"), std::string(200, 'x')}) {
    ServiceManager told(socket, std::chrono::milliseconds(2));
    told.TellReady([] { return true; });
    told.TellStopping();
  }
}

}  // namespace
}  // namespace maneuver::service_manager_test
