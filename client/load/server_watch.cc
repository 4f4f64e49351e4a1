#include "client/load/server_watch.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <utility>

namespace maneuver::load {
namespace {

constexpr std::chrono::milliseconds kBetween{500};

void Raise(std::optional<double>* peak, const std::optional<double>& value) {
  if (value) *peak = std::max(peak->value_or(*value), *value);
}

}  // namespace

absl::StatusOr<std::unique_ptr<ServerWatch>> ServerWatch::Start(const std::string& url) {
  auto before = FetchMetrics(url);
  if (!before.ok()) return before.status();
  return std::unique_ptr<ServerWatch>(new ServerWatch(url, *std::move(before)));
}

ServerWatch::ServerWatch(const std::string& url, MetricsPage before)
    : url_(url), before_(std::move(before)) {
  Look(before_);
  looker_ = std::thread([this] {
    while (!end_.StoppedWithin(kBetween)) {
      // A server under load may answer late; the next page will do.
      if (const auto page = FetchMetrics(url_); page.ok()) Look(*page);
    }
  });
}

ServerWatch::~ServerWatch() { StopLooking(); }

void ServerWatch::StopLooking() {
  end_.Stop();
  if (looker_.joinable()) looker_.join();
}

void ServerWatch::Look(const MetricsPage& page) {
  const MutexLock lock(mutex_);
  Raise(&peaks_.queued_targets, page.Sum("maneuver_queue_targets"));
  Raise(&peaks_.memory_bytes, page.Sum("process_resident_memory_bytes"));
}

absl::StatusOr<ServerChange> ServerWatch::End() {
  StopLooking();
  auto after = FetchMetrics(url_, std::chrono::seconds(10));
  if (!after.ok()) return after.status();
  Look(*after);
  const MutexLock lock(mutex_);
  return ServerChange{before_, *std::move(after), peaks_};
}

}  // namespace maneuver::load
