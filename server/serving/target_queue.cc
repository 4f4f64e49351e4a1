#include "server/serving/target_queue.h"

#include <algorithm>

namespace maneuver::serving {
namespace {

size_t TargetsLeft(const PredictionCall& call) { return call.targets.size() - call.next; }

}  // namespace

bool TargetQueue::HasRoom(size_t targets) const {
  return static_cast<size_t>(size_) + targets <= static_cast<size_t>(options_.max_queue);
}

void TargetQueue::Push(CallPtr call, TimePoint now) {
  call->submitted = now;
  call->next = 0;
  size_ += static_cast<int>(call->targets.size());
  calls_.push_back(std::move(call));
}

std::vector<TargetQueue::Item> TargetQueue::TakeWhere(
    const std::function<bool(const PredictionCall&)>& wanted) {
  std::vector<Item> taken;
  std::erase_if(calls_, [&](const CallPtr& call) {
    if (!wanted(*call)) return false;
    for (; call->next < call->targets.size(); ++call->next) taken.push_back({call, call->next});
    return true;
  });
  size_ -= static_cast<int>(taken.size());
  return taken;
}

std::vector<TargetQueue::Item> TargetQueue::TakeDead(TimePoint now) {
  return TakeWhere([now](const PredictionCall& call) { return !call.Alive(now).ok(); });
}

std::vector<TargetQueue::Item> TargetQueue::TakeAll() {
  return TakeWhere([](const PredictionCall&) { return true; });
}

TimePoint TargetQueue::NextBatchTime() const {
  if (calls_.empty()) return TimePoint::max();
  const PredictionCall& first = *calls_.front();
  size_t ready = 0;
  for (const CallPtr& call : calls_) {
    if (call->model == first.model) ready += TargetsLeft(*call);
    if (ready >= static_cast<size_t>(options_.max_batch)) return TimePoint::min();
  }
  return first.submitted + options_.max_queue_delay;
}

std::vector<TargetQueue::Item> TargetQueue::TakeBatch() {
  std::vector<Item> batch;
  if (calls_.empty()) return batch;
  const ModelHandle model = calls_.front()->model;
  const size_t max_batch = static_cast<size_t>(options_.max_batch);
  std::vector<CallPtr> unfinished;
  for (auto it = calls_.begin(); it != calls_.end() && batch.size() < max_batch;) {
    PredictionCall& call = **it;
    if (call.model != model) {
      ++it;
      continue;
    }
    for (; call.next < call.targets.size() && batch.size() < max_batch; ++call.next) {
      batch.push_back({*it, call.next});
    }
    if (TargetsLeft(call) > 0) unfinished.push_back(*it);
    it = calls_.erase(it);
  }
  calls_.insert(calls_.end(), unfinished.begin(), unfinished.end());
  size_ -= static_cast<int>(batch.size());
  return batch;
}

}  // namespace maneuver::serving
