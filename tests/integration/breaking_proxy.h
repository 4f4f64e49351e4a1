#ifndef MANEUVER_TESTS_INTEGRATION_BREAKING_PROXY_H_
#define MANEUVER_TESTS_INTEGRATION_BREAKING_PROXY_H_

#include <atomic>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace maneuver::integration {

// A network between a client and a server. It counts the bytes that the client sends, and breaks
// connections on request.
class BreakingProxy {
 public:
  // Called on a thread of a connection with the number of bytes that clients have sent in all,
  // before the last of them are passed on. If it returns true, the connection breaks and those
  // bytes are lost.
  using Breaks = std::function<bool(int64_t sent)>;

  // server: "127.0.0.1:1234".
  BreakingProxy(const std::string& server, Breaks breaks);
  ~BreakingProxy();

  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }
  int64_t sent() const { return sent_; }
  int connections() const { return connections_; }
  // Sets the server of later connections.
  void SetServer(const std::string& server);

 private:
  void Accept();
  void Pass(int client);
  int ConnectToServer();

  const Breaks breaks_;
  int listener_ = -1;
  int port_ = 0;
  std::atomic<int64_t> sent_ = 0;
  std::atomic<int> connections_ = 0;
  std::atomic<bool> ends_ = false;
  std::mutex mutex_;
  int server_port_ = 0;               // guarded by mutex_
  std::vector<std::thread> threads_;  // of the connections; of accepting_ until it has ended
  std::thread accepting_;
};

}  // namespace maneuver::integration

#endif  // MANEUVER_TESTS_INTEGRATION_BREAKING_PROXY_H_
