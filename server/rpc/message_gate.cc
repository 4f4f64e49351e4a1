#include "server/rpc/message_gate.h"

#include <algorithm>
#include <iterator>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "server/errors/error_details.h"

namespace maneuver::rpc {
namespace {

absl::Status TooMany(absl::string_view message) {
  return errors::WithRetryDelay(
      errors::WithReason(absl::ResourceExhaustedError(message), "MEMORY_FULL"), MessageGate::kTurn);
}

int64_t Find(const std::unordered_map<std::string, int64_t>& counts, const std::string& peer) {
  const auto found = counts.find(peer);
  return found == counts.end() ? 0 : found->second;
}

}  // namespace

void MessageGate::Receives(Call call, Time now) {
  receiving_.push_back({std::move(call), now});
  const auto place = std::prev(receiving_.end());
  places_.emplace(place->call.get(), place);
}

void MessageGate::Enter(std::shared_ptr<UnreceivedCall> call, std::string peer, Time now) {
  constexpr std::chrono::seconds kSecond{1};
  bool receives = false;
  {
    const MutexLock lock(mutex_);
    if (now - second_ >= kSecond) {
      second_ = now;
      entered_before_ = std::exchange(entered_, {});
    }
    ++entered_[peer];
    receives = !is_closed_ || !HasLarge(peer);
    if (receives) {
      Receives({call, std::move(peer)}, now);
    } else if (waiting_.size() < most_waiting_) {
      waiting_.push_back({std::move(call), std::move(peer)});
      return;
    }
  }
  if (receives) {
    call->Receive();
  } else {
    call->Refuse(
        TooMany("the server receives as many large requests as its memory allows; try again a "
                "little later"));
  }
}

bool MessageGate::Leave(const UnreceivedCall& call) {
  Place left;  // destroyed after the lock is released
  const MutexLock lock(mutex_);
  const auto place = places_.find(&call);
  left = std::move(*place->second);
  receiving_.erase(place->second);
  places_.erase(place);
  return !left.stopped;
}

bool MessageGate::HasSlow(Time now) {
  const MutexLock lock(mutex_);
  return !waiting_.empty() || (!receiving_.empty() && now - receiving_.front().since > kYoung);
}

void MessageGate::Weigh(const std::map<std::string, int64_t>& received) {
  const MutexLock lock(mutex_);
  is_weighed_ = true;
  with_large_.clear();
  for (const auto& [peer, bytes] : received) {
    const int64_t calls = Find(entered_, peer) + Find(entered_before_, peer);
    if (bytes > kSmallBytes * std::max<int64_t>(calls, 1)) with_large_.insert(peer);
  }
}

std::vector<MessageGate::Places::iterator> MessageGate::FindLarge(Time now) {
  std::vector<Places::iterator> large;
  for (auto place = receiving_.begin(); place != receiving_.end(); ++place) {
    if (now - place->since <= kYoung) break;
    // A stopped call counts until gRPC has let go of what it received.
    if (place->stopped || HasLarge(place->peer)) large.push_back(place);
  }
  return large;
}

size_t MessageGate::CountLarge(Time now) {
  const MutexLock lock(mutex_);
  return FindLarge(now).size();
}

void MessageGate::Stop(Place& place, Time now, Calls& stopped, Calls& cancelled) {
  if (!place.stopped) {
    place.stopped = now;
    stopped.push_back(place.call);
  } else if (now - *place.stopped > kTurn && !std::exchange(place.is_cancelled, true)) {
    cancelled.push_back(place.call);
  }
}

void MessageGate::StopLate(Time now, std::chrono::milliseconds longest) {
  Calls stopped;
  Calls cancelled;
  {
    const MutexLock lock(mutex_);
    for (Place& place : receiving_) {
      if (now - place.since <= longest) break;
      Stop(place, now, stopped, cancelled);
    }
  }
  for (const auto& call : stopped) {
    call->Stop(errors::WithReason(
        absl::DeadlineExceededError(absl::StrCat(
            "the request took more than ", absl::FormatDuration(absl::FromChrono(longest)),
            " to arrive (--request-timeout); send all of it at once, or send less")),
        "REQUEST_TOO_SLOW"));
  }
  for (const auto& call : cancelled) call->Cancel();
}

void MessageGate::StopExcess(Time now, size_t allowed) {
  std::vector<Call> begun;
  Calls stopped;
  Calls cancelled;
  {
    const MutexLock lock(mutex_);
    const auto large = FindLarge(now);
    is_closed_ = large.size() > allowed;
    size_t left = is_closed_ ? large.size() - allowed : 0;
    const auto stop = [&](Place& place) {
      --left;
      Stop(place, now, stopped, cancelled);
    };
    auto oldest = large.begin();
    while (left > 0 && now - (*oldest)->since > kTurn) stop(**oldest++);
    // The others have come far, and the first are the closest to their end.
    for (auto youngest = large.end(); left > 0 && youngest != oldest;) stop(**--youngest);
    if (!is_closed_) {
      begun.swap(waiting_);
      for (const Call& call : begun) Receives(call, now);
    }
  }
  for (const Call& call : begun) call.call->Receive();
  for (const auto& call : stopped) {
    call->Stop(
        TooMany("the server's memory was nearly full while the request arrived; try again a "
                "little later"));
  }
  for (const auto& call : cancelled) call->Cancel();
}

}  // namespace maneuver::rpc
