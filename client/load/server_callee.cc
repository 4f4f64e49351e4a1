#include "client/load/server_callee.h"

#include <utility>

#include "client/error_details.h"

namespace maneuver::load {

CallOutcome OutcomeOf(const absl::StatusOr<v1::PredictResponse>& answer) {
  CallOutcome outcome;
  outcome.status = answer.status();
  if (!answer.ok()) return outcome;
  const auto refuse = [&outcome](const v1::Status& error) {
    ++outcome.refused_targets;
    if (outcome.refusal.empty()) outcome.refusal = error.message();
  };
  for (const v1::ScenarioPrediction& prediction : answer->predictions()) {
    if (prediction.has_error()) refuse(prediction.error());
    for (const v1::TargetPrediction& target : prediction.targets()) {
      if (target.has_error()) {
        refuse(target.error());
      } else {
        ++outcome.targets;
      }
    }
  }
  return outcome;
}

void ServerCallee::Start(const PlannedCall& call, std::function<void(const CallOutcome&)> on_end) {
  client::CallOptions options;
  options.timeout = absl::FromChrono(call.timeout);
  options.cancellation = &cancellation_;
  const auto& connection = connections_[calls_++ % connections_.size()];
  connection->StartPrediction(
      requests_[call.choice % requests_.size()],
      [on_end = std::move(on_end)](const absl::StatusOr<v1::PredictResponse>& answer) {
        on_end(OutcomeOf(answer));
      },
      options);
}

}  // namespace maneuver::load
