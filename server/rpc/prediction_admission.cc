#include "server/rpc/prediction_admission.h"

#include <algorithm>

#include "server/rpc/request_outline.h"
#include "server/serving/answer_size.h"

namespace maneuver::rpc {

serving::TimePoint OnSteadyClock(std::chrono::system_clock::time_point deadline) {
  if (deadline == std::chrono::system_clock::time_point::max()) return serving::TimePoint::max();
  return std::chrono::steady_clock::now() + (deadline - std::chrono::system_clock::now());
}

absl::Status CheckWait(serving::BatchScheduler& scheduler, std::string_view method,
                       std::chrono::system_clock::time_point deadline,
                       const grpc::ByteBuffer& request) {
  if (method.ends_with("/RegisterMap")) return absl::OkStatus();
  return scheduler.CheckWait(serving::Priority::kInteractive, CountTargets(request),
                             OnSteadyClock(deadline));
}

absl::Status AdmitTargets(security::AccessControl& access, const security::Credentials& caller,
                          const Scenarios& scenarios) {
  return access.AdmitTargets(caller, CountTargets(scenarios));
}

absl::StatusOr<serving::SendMemory::Share> ReserveAnswer(serving::SendMemory& memory,
                                                         const Scenarios& scenarios,
                                                         const v1::ModelSpec& spec,
                                                         const serving::Question& question,
                                                         bool sigma_trajectories) {
  const int targets = CountTargets(scenarios);
  const int64_t bytes =
      serving::MostBytesOfAnswer(spec, question, sigma_trajectories, scenarios.size(), targets);
  return memory.Reserve(bytes, std::max(1, targets));
}

}  // namespace maneuver::rpc
