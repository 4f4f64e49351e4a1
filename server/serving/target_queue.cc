#include "server/serving/target_queue.h"

#include <algorithm>

namespace maneuver::serving {
namespace {

size_t TargetsLeft(const PredictionCall& call) { return call.targets.size() - call.next; }

}  // namespace

int64_t TargetQueue::Line::PlaceOf(size_t size) const {
  return come + kOvertaking * static_cast<int64_t>(size);
}

int TargetQueue::SizeBefore(Priority priority, size_t targets) const {
  const Line& own = line(priority);
  int before = priority == Priority::kBulk ? size() : size(priority);
  const int64_t place = own.PlaceOf(targets);
  for (auto it = own.calls.rbegin(); it != own.calls.rend() && it->first > place; ++it) {
    before -= static_cast<int>(TargetsLeft(*it->second));
  }
  return before;
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
  const size_t targets = call->targets.size();
  own.calls.emplace(own.PlaceOf(targets), std::move(call));
  own.come += static_cast<int64_t>(targets);
}

std::vector<TargetQueue::Item> TargetQueue::TakeWhere(
    const std::function<bool(const PredictionCall&)>& wanted) {
  std::vector<Item> taken;
  for (Line& line : lines_) {
    std::erase_if(line.calls, [&](const auto& place) {
      const CallPtr& call = place.second;
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
  return TakeWhere([now](const PredictionCall& call) { return !call.CheckWanted(now).ok(); });
}

std::vector<TargetQueue::Item> TargetQueue::TakeAll() {
  return TakeWhere([](const PredictionCall&) { return true; });
}

TimePoint TargetQueue::NextBatchTime() const {
  return std::min(NextBatchTime(lines_[0]), NextBatchTime(lines_[1]));
}

TimePoint TargetQueue::NextBatchTime(const Line& line) const {
  if (line.calls.empty()) return TimePoint::max();
  const ModelHandle& model = line.calls.begin()->second->model;
  size_t ready = 0;
  TimePoint oldest = TimePoint::max();
  for (const auto& [place, call] : line.calls) {
    if (call->model != model) continue;
    ready += TargetsLeft(*call);
    if (ready >= static_cast<size_t>(options_.max_batch)) return TimePoint::min();
    oldest = std::min(oldest, call->submitted);
  }
  return oldest + options_.max_queue_delay;
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
  const ModelHandle model = line.calls.begin()->second->model;
  const size_t max_batch = static_cast<size_t>(options_.max_batch);
  for (auto it = line.calls.begin(); it != line.calls.end() && batch.size() < max_batch;) {
    const CallPtr shared = it->second;
    PredictionCall& call = *shared;
    if (call.model != model) {
      ++it;
      continue;
    }
    for (; call.next < call.targets.size() && batch.size() < max_batch; ++call.next) {
      batch.push_back({shared, call.next});
    }
    if (TargetsLeft(call) > 0) break;  // the batch is full
    line.bytes -= call.bytes;
    it = line.calls.erase(it);
  }
  line.targets -= static_cast<int>(batch.size());
  return batch;
}

}  // namespace maneuver::serving
