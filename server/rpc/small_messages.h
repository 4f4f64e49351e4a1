// Bounds the messages that anybody may send, while they are received. gRPC receives a message of any
// size up to its limit, and tells its size only then. But small ones arrive at once, and a
// connection with others brings many bytes meanwhile.

#ifndef MANEUVER_SERVER_RPC_SMALL_MESSAGES_H_
#define MANEUVER_SERVER_RPC_SMALL_MESSAGES_H_

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "locks/mutex.h"

namespace maneuver::rpc {

// Safe to use from any thread.
class SmallMessages {
 public:
  static constexpr int64_t kMostBytes = int64_t{4} << 10;  // of one message
  // Of all connections, since they have had messages underway.
  static constexpr int64_t kMostBytesUnderway = int64_t{4} << 20;

  // Returns the bytes that the connection of `peer`, "ipv4:127.0.0.1:4567", has received since it
  // began. Called by one thread at a time.
  using ReceivedBy = std::function<int64_t(const std::string& peer)>;

  SmallMessages() = default;
  ~SmallMessages();
  SmallMessages(const SmallMessages&) = delete;
  SmallMessages& operator=(const SmallMessages&) = delete;

  // Begins to look at the connections, a hundred times a second while messages are underway. Call it
  // at most once.
  void Watch(ReceivedBy received);

  // Adds a message that is about to be received, and returns its number.
  //   cancel: ends its call. Called at most once, perhaps during or after Remove.
  int64_t Add(std::string peer, std::function<void()> cancel);
  // Removes a message that is there, or will not come. Returns false if it was cancelled.
  bool Remove(int64_t number);

  // Cancels the messages of those connections that brought the most, until the others have brought
  // at most kMostBytesUnderway together.
  void CancelExcess(const ReceivedBy& received);

 private:
  struct Message {
    std::string peer;
    std::function<void()> cancel;
    bool is_cancelled = false;
  };

  void Run(const ReceivedBy& received);

  Mutex looking_;
  std::map<std::string, int64_t> before_ ABSL_GUARDED_BY(looking_);  // received at the first look
  Mutex mutex_;
  CondVar changed_;
  bool is_stopped_ ABSL_GUARDED_BY(mutex_) = false;
  int64_t last_number_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<int64_t, Message> underway_ ABSL_GUARDED_BY(mutex_);
  std::thread thread_;
};

// RESOURCE_EXHAUSTED (REQUEST_TOO_LARGE): the message is larger than a small one.
absl::Status NotSmall();

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_SMALL_MESSAGES_H_
