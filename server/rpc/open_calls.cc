#include "server/rpc/open_calls.h"

#include <numeric>

namespace maneuver::rpc {

int64_t OpenCalls::Begin(const std::string& peer) {
  const MutexLock lock(mutex_);
  ++calls_[peer][looks_];
  return looks_;
}

void OpenCalls::End(const std::string& peer, int64_t begun) {
  const MutexLock lock(mutex_);
  const auto calls = calls_.find(peer);
  const auto same = calls->second.find(begun);
  if (--same->second > 0) return;
  calls->second.erase(same);
  if (calls->second.empty()) calls_.erase(calls);
}

std::set<std::string> OpenCalls::FindCrowded(int most) {
  const MutexLock lock(mutex_);
  ++looks_;
  std::set<std::string> crowded;
  for (const auto& [peer, calls] : calls_) {
    const auto young = calls.upper_bound(looks_ - kOld);
    const int old = std::accumulate(calls.begin(), young, 0,
                                    [](int sum, const auto& each) { return sum + each.second; });
    if (old > most) crowded.insert(peer);
  }
  return crowded;
}

}  // namespace maneuver::rpc
