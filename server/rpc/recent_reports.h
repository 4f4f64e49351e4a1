// Remembers the last answers to reports of outcomes, so that a report that is sent again is counted
// once.

#ifndef MANEUVER_SERVER_RPC_RECENT_REPORTS_H_
#define MANEUVER_SERVER_RPC_RECENT_REPORTS_H_

#include <cstddef>
#include <deque>
#include <map>
#include <string>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"
#include "maneuver/v1/outcome_service.pb.h"

namespace maneuver::rpc {

// Safe to use from any thread.
class RecentReports {
 public:
  //   max_bytes: of all answers together; the oldest make room
  explicit RecentReports(size_t max_bytes) : max_bytes_(max_bytes) {}

  // Returns the name of a report here: a SHA-256 of all that it says, so nobody gets the answer to
  // another report. Empty for a report without a request_id, which is not remembered.
  static std::string NameOf(const v1::ReportOutcomesRequest& report);

  // Returns whether the answer to a report is known, and copies it.
  bool Find(const std::string& name, v1::ReportOutcomesResponse* answer) const;
  // Remembers an answer. Does nothing if the name is empty.
  void Keep(const std::string& name, const v1::ReportOutcomesResponse& answer);

 private:
  const size_t max_bytes_;
  mutable Mutex mutex_;
  std::map<std::string, std::string> answers_ ABSL_GUARDED_BY(mutex_);  // serialised, by name
  std::deque<std::string> by_age_ ABSL_GUARDED_BY(mutex_);              // names, oldest first
  size_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_RECENT_REPORTS_H_
