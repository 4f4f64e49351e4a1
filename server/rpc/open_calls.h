// Counts the calls of each connection. gRPC has a limit of them, but keeps it only with peers that have
// acknowledged it.

#ifndef MANEUVER_SERVER_RPC_OPEN_CALLS_H_
#define MANEUVER_SERVER_RPC_OPEN_CALLS_H_

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <unordered_map>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"

namespace maneuver::rpc {

// Safe to use from any thread.
class OpenCalls {
 public:
  // A call that was open at so many looks is old. Under overload, calls whose callers have given up
  // stay open until the server gets to them: younger ones say nothing about their callers.
  static constexpr int64_t kOld = 8;

  // Adds a call, and returns how many looks there have been.
  //   peer: of the call's connection, such as "ipv4:127.0.0.1:4567"
  int64_t Begin(const std::string& peer);
  // Removes a call.
  //   begun: as Begin returned it
  void End(const std::string& peer, int64_t begun);

  // Returns the peers that have more than `most` old calls.
  std::set<std::string> FindCrowded(int most);

 private:
  using CallsByBegin = std::map<int64_t, int>;  // without zeros

  Mutex mutex_;
  int64_t looks_ ABSL_GUARDED_BY(mutex_) = 0;
  std::unordered_map<std::string, CallsByBegin> calls_ ABSL_GUARDED_BY(mutex_);  // by peer
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_OPEN_CALLS_H_
