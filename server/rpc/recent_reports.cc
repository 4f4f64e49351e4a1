#include "server/rpc/recent_reports.h"

#include <utility>

#include "model/files/digest.h"

namespace maneuver::rpc {
namespace {

// What a name and the places in both containers take.
constexpr size_t kBytesOfName = 384;

}  // namespace

std::string RecentReports::NameOf(const v1::ReportOutcomesRequest& report) {
  return report.request_id().empty() ? "" : files::Sha256Hex(report.SerializeAsString());
}

bool RecentReports::Find(const std::string& name, v1::ReportOutcomesResponse* answer) const {
  const MutexLock lock(mutex_);
  const auto found = answers_.find(name);
  return found != answers_.end() && answer->ParseFromString(found->second);
}

void RecentReports::Keep(const std::string& name, const v1::ReportOutcomesResponse& answer) {
  if (name.empty()) return;
  std::string bytes = answer.SerializeAsString();
  const size_t size = bytes.size() + kBytesOfName;
  const MutexLock lock(mutex_);
  if (!answers_.emplace(name, std::move(bytes)).second) return;
  by_age_.push_back(name);
  bytes_ += size;
  while (bytes_ > max_bytes_) {
    const auto oldest = answers_.find(by_age_.front());
    bytes_ -= oldest->second.size() + kBytesOfName;
    answers_.erase(oldest);
    by_age_.pop_front();
  }
}

}  // namespace maneuver::rpc
