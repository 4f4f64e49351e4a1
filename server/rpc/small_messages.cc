#include "server/rpc/small_messages.h"

#include <algorithm>
#include <set>
#include <utility>
#include <vector>

#include "server/errors/error_details.h"

namespace maneuver::rpc {
namespace {

constexpr std::chrono::milliseconds kInterval{10};

}  // namespace

SmallMessages::~SmallMessages() {
  {
    const MutexLock lock(mutex_);
    is_stopped_ = true;
  }
  changed_.NotifyAll();
  if (thread_.joinable()) thread_.join();
}

void SmallMessages::Watch(ReceivedBy received) {
  thread_ = std::thread([this, received = std::move(received)] { Run(received); });
}

void SmallMessages::Run(const ReceivedBy& received) {
  for (;;) {
    bool was_idle = false;
    {
      const MutexLock lock(mutex_);
      was_idle = underway_.empty();
      while (underway_.empty() && !is_stopped_) changed_.Wait(mutex_);
      const auto end = std::chrono::steady_clock::now() + kInterval;
      while (!is_stopped_ && changed_.WaitUntil(mutex_, end)) {
      }
      if (is_stopped_) return;
    }
    if (was_idle) {
      const MutexLock looking(looking_);
      before_.clear();
    }
    CancelExcess(received);
  }
}

int64_t SmallMessages::Add(std::string peer, std::function<void()> cancel) {
  int64_t number = 0;
  bool is_first = false;
  {
    const MutexLock lock(mutex_);
    is_first = underway_.empty();
    number = ++last_number_;
    underway_.emplace(number, Message{std::move(peer), std::move(cancel)});
  }
  if (is_first) changed_.NotifyOne();
  return number;
}

bool SmallMessages::Remove(int64_t number) {
  Message removed;  // destroyed after the lock is released
  const MutexLock lock(mutex_);
  const auto found = underway_.find(number);
  removed = std::move(found->second);
  underway_.erase(found);
  return !removed.is_cancelled;
}

void SmallMessages::CancelExcess(const ReceivedBy& received) {
  const MutexLock looking(looking_);
  std::set<std::string> peers;
  {
    const MutexLock lock(mutex_);
    for (const auto& [number, message] : underway_) peers.insert(message.peer);
  }
  std::erase_if(before_, [&peers](const auto& peer) { return !peers.contains(peer.first); });
  std::vector<std::pair<int64_t, std::string>> brought;
  int64_t sum = 0;
  for (const std::string& peer : peers) {
    const int64_t total = received(peer);
    const int64_t bytes = total - before_.emplace(peer, total).first->second;
    brought.emplace_back(bytes, peer);
    sum += bytes;
  }
  if (sum <= kMostBytesUnderway) return;
  std::ranges::sort(brought, std::greater());
  std::set<std::string> refused;
  for (const auto& [bytes, peer] : brought) {
    if (sum <= kMostBytesUnderway) break;
    sum -= bytes;
    refused.insert(peer);
    before_.erase(peer);
  }
  std::vector<std::function<void()>> cancelled;
  {
    const MutexLock lock(mutex_);
    for (auto& [number, message] : underway_) {
      if (message.is_cancelled || !refused.contains(message.peer)) continue;
      message.is_cancelled = true;
      cancelled.push_back(message.cancel);
    }
  }
  for (const auto& cancel : cancelled) cancel();
}

absl::Status NotSmall() {
  return errors::WithReason(absl::ResourceExhaustedError(
                                "a message of this method has at most 4 KiB; send less, or send it "
                                "on a connection that has nothing larger underway"),
                            "REQUEST_TOO_LARGE");
}

}  // namespace maneuver::rpc
