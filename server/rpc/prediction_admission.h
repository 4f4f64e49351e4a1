// Decides whether a prediction is admitted: its deadline must leave enough time, and its caller
// must not ask for too many targets at a time. Unary calls and requests of a stream take the same
// steps:
//
//   CheckWait       before the request is parsed: is it worth that work?
//   AdmitTargets    once it is parsed
//   ReserveAnswer   once its model is known: is there memory for the answer?

#ifndef MANEUVER_SERVER_RPC_PREDICTION_ADMISSION_H_
#define MANEUVER_SERVER_RPC_PREDICTION_ADMISSION_H_

#include <grpcpp/support/byte_buffer.h>

#include <chrono>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/rpc/prediction_plan.h"
#include "server/security/access_control.h"
#include "server/serving/batch_scheduler.h"
#include "server/serving/prediction_call.h"
#include "server/serving/send_memory.h"

namespace maneuver::rpc {

// Returns a caller's deadline on the clock of the scheduler.
serving::TimePoint OnSteadyClock(std::chrono::system_clock::time_point deadline);

// Checks whether the scheduler expects to answer a unary call in time. This is the check_request of
// the prediction service (NamedService). RegisterMap is always worth its work. Errors: those of
// BatchScheduler::CheckWait.
absl::Status CheckWait(serving::BatchScheduler& scheduler, std::string_view method,
                       std::chrono::system_clock::time_point deadline,
                       const grpc::ByteBuffer& request);

// Checks whether the caller may ask for these targets now. Errors: those of
// AccessControl::AdmitTargets.
absl::Status AdmitTargets(security::AccessControl& access, const security::Credentials& caller,
                          const Scenarios& scenarios);

// Reserves memory for the largest answer that the request can have. Errors: those of
// SendMemory::Reserve.
absl::StatusOr<serving::SendMemory::Share> ReserveAnswer(serving::SendMemory& memory,
                                                         const Scenarios& scenarios,
                                                         const v1::ModelSpec& spec,
                                                         const serving::Question& question,
                                                         bool sigma_trajectories);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_PREDICTION_ADMISSION_H_
