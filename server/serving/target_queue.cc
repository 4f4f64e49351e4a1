#include "server/serving/target_queue.h"

#include <algorithm>

namespace maneuver::serving {
namespace {

size_t TargetsLeft(const PredictionCall& call) { return call.targets.size() - call.next; }

}  // namespace

int TargetQueue::SizeBefore(Priority priority) const {
  return priority == Priority::kBulk ? size() : size(priority);
}

bool TargetQueue::HasRoom(const PredictionCall& call) const {
  const Line& own = line(call.priority);
  return static_cast<size_t>(own.targets) + call.targets.size() <=
             static_cast<size_t>(options_.max_queue) &&
         own.bytes + call.bytes <= options_.max_queue_bytes;
}

void TargetQueue::Push(CallPtr call, TimePoint now) {
  call->submitted = now;
  call->next = 0;
  Line& own = line(call->priority);
  own.targets += static_cast<int>(call->targets.size());
  own.bytes += call->bytes;
  own.calls.push_back(std::move(call));
}

std::vector<TargetQueue::Item> TargetQueue::TakeWhere(
    const std::function<bool(const PredictionCall&)>& wanted) {
  std::vector<Item> taken;
  for (Line& line : lines_) {
    std::erase_if(line.calls, [&](const CallPtr& call) {
      if (!wanted(*call)) return false;
      line.targets -= static_cast<int>(TargetsLeft(*call));
      line.bytes -= call->bytes;
      for (; call->next < call->targets.size(); ++call->next) taken.push_back({call, call->next});
      return true;
    });
  }
  return taken;
}

std::vector<TargetQueue::Item> TargetQueue::TakeDead(TimePoint now) {
  return TakeWhere([now](const PredictionCall& call) { return !call.Alive(now).ok(); });
}

std::vector<TargetQueue::Item> TargetQueue::TakeAll() {
  return TakeWhere([](const PredictionCall&) { return true; });
}

TimePoint TargetQueue::NextBatchTime() const {
  return std::min(NextBatchTime(lines_[0]), NextBatchTime(lines_[1]));
}

TimePoint TargetQueue::NextBatchTime(const Line& line) const {
  if (line.calls.empty()) return TimePoint::max();
  const PredictionCall& first = *line.calls.front();
  size_t ready = 0;
  for (const CallPtr& call : line.calls) {
    if (call->model == first.model) ready += TargetsLeft(*call);
    if (ready >= static_cast<size_t>(options_.max_batch)) return TimePoint::min();
  }
  return first.submitted + options_.max_queue_delay;
}

Priority TargetQueue::NextPriority() const {
  const int bulk = size(Priority::kBulk);
  if (bulk == 0) return Priority::kInteractive;
  if (size(Priority::kInteractive) == 0) return Priority::kBulk;
  return owed_to_bulk_ >= std::min(bulk, options_.max_batch) ? Priority::kBulk
                                                             : Priority::kInteractive;
}

std::vector<TargetQueue::Item> TargetQueue::TakeBatch() {
  const Priority priority = NextPriority();
  const bool both_wait = size(Priority::kInteractive) > 0 && size(Priority::kBulk) > 0;
  std::vector<Item> batch = TakeBatch(line(priority));
  const double targets = static_cast<double>(batch.size());
  if (priority == Priority::kBulk) {
    owed_to_bulk_ = std::max(0.0, owed_to_bulk_ - targets);
  } else if (both_wait) {
    owed_to_bulk_ += targets * options_.bulk_share / (1.0 - options_.bulk_share);
  }
  return batch;
}

std::vector<TargetQueue::Item> TargetQueue::TakeBatch(Line& line) {
  std::vector<Item> batch;
  if (line.calls.empty()) return batch;
  const ModelHandle model = line.calls.front()->model;
  const size_t max_batch = static_cast<size_t>(options_.max_batch);
  std::vector<CallPtr> unfinished;
  for (auto it = line.calls.begin(); it != line.calls.end() && batch.size() < max_batch;) {
    PredictionCall& call = **it;
    if (call.model != model) {
      ++it;
      continue;
    }
    for (; call.next < call.targets.size() && batch.size() < max_batch; ++call.next) {
      batch.push_back({*it, call.next});
    }
    if (TargetsLeft(call) > 0) {
      unfinished.push_back(*it);
    } else {
      line.bytes -= call.bytes;
    }
    it = line.calls.erase(it);
  }
  line.calls.insert(line.calls.end(), unfinished.begin(), unfinished.end());
  line.targets -= static_cast<int>(batch.size());
  return batch;
}

}  // namespace maneuver::serving
