// Measures and closes connections of this process. It finds them through the operating system,
// because gRPC does not expose them.

#ifndef MANEUVER_SERVER_RPC_OPEN_CONNECTIONS_H_
#define MANEUVER_SERVER_RPC_OPEN_CONNECTIONS_H_

#include <sys/socket.h>

#include <chrono>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>

namespace maneuver::rpc {

// Returns how gRPC names the caller at an address: "ipv4:127.0.0.1:4567", "ipv6:%5B::1%5D:4567", and
// with the number of the link, here 2, "ipv6:%5Bfe80::1%252%5D:4567". Empty for one that is not of IP.
std::string PeerName(const sockaddr_storage& peer);

// Shuts down, in both directions, every TCP connection that was accepted on `port`. Both ends then
// see a broken connection.
void CutOffConnections(int port);
// The same for those of `peers`, by PeerName. Returns how many it shut down, without those that were shut down before.
int CutOffConnections(int port, const std::set<std::string>& peers);

// Tells how much a connection of a port has received, by its caller. Not thread-safe.
class ReceivedByPeer {
 public:
  //   port: on which the connections were accepted
  explicit ReceivedByPeer(int port) : port_(port) {}

  // Returns the bytes since the connection began; 0 if there is none.
  //   peer: by PeerName
  int64_t Bytes(const std::string& peer);

 private:
  const int port_;
  std::map<std::string, int> descriptors_;  // by peer, as they were lately
};

// Knows how much each connection of a port sent in the last one to two seconds. A message that gRPC
// has received in part, or has not handed over yet, cannot be refused: only its connection can be
// closed. Not thread-safe.
class ReceivedBytes {
 public:
  //   port: on which the connections were accepted
  explicit ReceivedBytes(int port) : port_(port) {}

  // Notes, once a second, what each connection has received until now. Call it at least as often.
  void Note(std::chrono::steady_clock::time_point now);
  // Returns the bytes since the note of one to two seconds ago, by the PeerName of the connection's
  // caller.
  std::map<std::string, int64_t> Recent() const;
  // Shuts down the connections that have received the most since the note of one to two seconds
  // ago, until the others have received at most `left` bytes together. Returns how many it shut
  // down, without those that were shut down before.
  int CutOffLargest(int64_t left) const;

 private:
  using Totals = std::map<int, int64_t>;  // bytes since the connection began, by its descriptor

  Totals Read() const;
  Totals ReadRecent() const;

  const int port_;
  Totals latest_;
  Totals before_;  // a second earlier
  std::chrono::steady_clock::time_point noted_{};
};

// Returns how many connections may be open: `wanted`, but at most half of the files that this process
// may have open. When they run out, gRPC does not listen again (LostListener, library_logs.h).
int AffordableConnections(int wanted);

// Keeps a port from having too many connections. gRPC accepts every connection and knows no limit,
// so those that are too many are shut down. Not thread-safe.
class ConnectionLimit {
 public:
  //   port: on which the connections were accepted
  //   most: connections that stay
  ConnectionLimit(int port, int most) : port_(port), most_(most) {}

  // Shuts down connections until `most` are left. The newest go: first those that an earlier call
  // did not see, and of them those with the highest descriptors. Returns how many it shut down.
  // Takes little time while this process has few open files.
  int Enforce();

 private:
  const int port_;
  const int most_;
  std::set<std::pair<int, std::string>> known_;  // connections that stayed: descriptor and peer
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_OPEN_CONNECTIONS_H_
