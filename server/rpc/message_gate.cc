#include "server/rpc/message_gate.h"

#include <algorithm>
#include <iterator>
#include <utility>
#include <vector>

#include "server/errors/error_details.h"

namespace maneuver::rpc {
namespace {

absl::Status TooManyMessages() {
  return errors::WithRetryDelay(
      errors::WithReason(absl::ResourceExhaustedError("the server receives as many requests as its "
                                                      "memory allows; try again a little later"),
                         "MEMORY_FULL"),
      MessageGate::kTurn);
}

}  // namespace

void MessageGate::Receives(std::shared_ptr<UnreceivedCall> call, Time now) {
  receiving_.push_back({std::move(call), now});
  const auto place = std::prev(receiving_.end());
  places_.emplace(place->call.get(), place);
}

void MessageGate::Enter(std::shared_ptr<UnreceivedCall> call, Time now) {
  bool receives = false;
  {
    const MutexLock lock(mutex_);
    receives = !is_closed_;
    if (receives) {
      Receives(call, now);
    } else if (waiting_.size() < most_waiting_) {
      waiting_.push_back(std::move(call));
      return;
    }
  }
  if (receives) {
    call->Receive();
  } else {
    call->Refuse(TooManyMessages());
  }
}

bool MessageGate::Leave(const UnreceivedCall& call) {
  Place left;  // destroyed after the lock is released
  const MutexLock lock(mutex_);
  const auto place = places_.find(&call);
  left = std::move(*place->second);
  receiving_.erase(place->second);
  places_.erase(place);
  return !left.is_cancelled;
}

size_t MessageGate::CountSlow(Time now) {
  const MutexLock lock(mutex_);
  const auto is_slow = [now](const Place& place) { return now - place.since > kYoung; };
  return static_cast<size_t>(
      std::distance(receiving_.begin(), std::ranges::find_if_not(receiving_, is_slow)));
}

void MessageGate::Look(Time now, size_t allowed) {
  std::vector<std::shared_ptr<UnreceivedCall>> begun;
  std::vector<std::shared_ptr<UnreceivedCall>> cancelled;
  {
    const MutexLock lock(mutex_);
    const auto is_slow = [now](const Place& place) { return now - place.since > kYoung; };
    const auto young = std::ranges::find_if_not(receiving_, is_slow);
    const auto slow = static_cast<size_t>(std::distance(receiving_.begin(), young));
    // A cancelled call counts until gRPC has let go of what it received.
    is_closed_ = slow > allowed;
    size_t left = is_closed_ ? slow - allowed : 0;
    const auto cancel = [&](Place& place) {
      --left;
      if (!std::exchange(place.is_cancelled, true)) cancelled.push_back(place.call);
    };
    auto oldest = receiving_.begin();
    while (left > 0 && now - oldest->since > kTurn) cancel(*oldest++);
    // The others have come far, and the first are the closest to their end.
    for (auto youngest = young; left > 0 && youngest != oldest;) cancel(*--youngest);
    if (!is_closed_) {
      begun.swap(waiting_);
      for (const auto& call : begun) Receives(call, now);
    }
  }
  for (const auto& call : begun) call->Receive();
  for (const auto& call : cancelled) call->Cancel();
}

}  // namespace maneuver::rpc
