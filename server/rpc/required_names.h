// Checks the action names that a caller requires.

#ifndef MANEUVER_SERVER_RPC_REQUIRED_NAMES_H_
#define MANEUVER_SERVER_RPC_REQUIRED_NAMES_H_

#include <google/protobuf/repeated_field.h>

#include <span>
#include <string>

#include "absl/status/status.h"
#include "server/security/resource_name.h"

namespace maneuver::rpc {

using ActionNameList = google::protobuf::RepeatedPtrField<std::string>;

// Returns OK if `names`, the action names of the version that answers, contain all required names.
// Otherwise returns FAILED_PRECONDITION with the reason ACTION_NAME_GONE. Its metadata has the
// version as `model_version`, and the first errors::kMaxListedViolations missing names as
// `action_name_0`, `action_name_1` and so on. INVALID_ARGUMENT for names that are too long for an
// action.
absl::Status CheckRequiredNames(const ActionNameList& required, std::span<const std::string> names,
                                const security::ModelVersionName& version);

// Returns the field for the names of the actions; nullptr unless the request asks for them.
template <typename Request, typename Response>
ActionNameList* NamesIfWanted(const Request& request, Response* response) {
  return request.include_action_names() ? response->mutable_action_names() : nullptr;
}

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_REQUIRED_NAMES_H_
