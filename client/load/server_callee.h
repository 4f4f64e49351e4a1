// A server under load, over dedicated connections.

#ifndef MANEUVER_CLIENT_LOAD_SERVER_CALLEE_H_
#define MANEUVER_CLIENT_LOAD_SERVER_CALLEE_H_

#include <atomic>
#include <memory>
#include <vector>

#include "client/client.h"
#include "client/load/load_run.h"

namespace maneuver::load {

// Uses the connections in turn. Thread-safe.
class ServerCallee final : public Callee {
 public:
  // Both must outlive this object and its calls, and have at least one element.
  ServerCallee(const std::vector<std::unique_ptr<client::Client>>& connections,
               const std::vector<client::PreparedPrediction>& requests)
      : connections_(connections), requests_(requests) {}

  void Start(const PlannedCall& call, std::function<void(const CallOutcome&)> on_end) override;
  void CancelAll() override { cancellation_.Cancel(); }

 private:
  const std::vector<std::unique_ptr<client::Client>>& connections_;
  const std::vector<client::PreparedPrediction>& requests_;
  client::Cancellation cancellation_;
  std::atomic<size_t> calls_ = 0;
};

// Returns what an answer says about its targets.
CallOutcome OutcomeOf(const absl::StatusOr<v1::PredictResponse>& answer);

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_SERVER_CALLEE_H_
