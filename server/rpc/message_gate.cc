#include "server/rpc/message_gate.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "server/errors/error_details.h"

namespace maneuver::rpc {
namespace {

absl::Status TooManyMessages() {
  return errors::WithRetryDelay(
      errors::WithReason(
          absl::ResourceExhaustedError(
              "the server receives as many requests as its memory allows; try again a little later"),
          "MEMORY_FULL"),
      MessageGate::kTurn);
}

}  // namespace

void MessageGate::Enter(std::shared_ptr<UnreceivedCall> call, Time now) {
  bool receives = false;
  {
    const MutexLock lock(mutex_);
    receives = receiving_.size() < most_;
    if (receives) {
      receiving_.push_back({call, now});
    } else if (waiting_.size() < most_waiting_) {
      waiting_.push_back({std::move(call), now});
      return;
    }
  }
  if (receives) {
    call->Receive();
  } else {
    call->Refuse(TooManyMessages());
  }
}

bool MessageGate::Leave(const UnreceivedCall& call, Time now) {
  std::shared_ptr<UnreceivedCall> next;
  Place left;
  {
    const MutexLock lock(mutex_);
    const auto place = std::ranges::find_if(
        receiving_, [&call](const Place& other) { return other.call.get() == &call; });
    left = std::move(*place);
    receiving_.erase(place);
    if (!waiting_.empty()) {
      next = std::move(waiting_.front().call);
      waiting_.pop_front();
      receiving_.push_back({next, now});
    }
  }
  if (next != nullptr) next->Receive();
  return !left.is_cancelled;
}

void MessageGate::Look(Time now) {
  std::vector<std::shared_ptr<UnreceivedCall>> cancelled;
  std::vector<std::shared_ptr<UnreceivedCall>> refused;
  {
    const MutexLock lock(mutex_);
    while (!waiting_.empty() && now - waiting_.front().since > kLongestWait) {
      refused.push_back(std::move(waiting_.front().call));
      waiting_.pop_front();
    }
    // A cancelled call keeps its place until gRPC has let go of what it received.
    size_t places = 0;
    for (Place& place : receiving_) {
      if (places == waiting_.size() || now - place.since <= kTurn) break;
      ++places;
      if (!std::exchange(place.is_cancelled, true)) cancelled.push_back(place.call);
    }
  }
  for (const auto& call : cancelled) call->Cancel();
  for (const auto& call : refused) call->Refuse(TooManyMessages());
}

}  // namespace maneuver::rpc
