// What a server is for, of several that share a store.

#ifndef MANEUVER_SERVER_MANEUVERD_ROLE_H_
#define MANEUVER_SERVER_MANEUVERD_ROLE_H_

#include <string_view>

namespace maneuver {

// Every role answers the calls about models, datasets and jobs.
enum class Role {
  kAll,    // predicts and runs jobs
  kApi,    // does neither
  kServe,  // predicts
  kWork,   // runs jobs
};

constexpr bool Predicts(Role role) { return role == Role::kAll || role == Role::kServe; }
constexpr bool RunsJobs(Role role) { return role == Role::kAll || role == Role::kWork; }

constexpr std::string_view RoleName(Role role) {
  switch (role) {
    case Role::kApi:
      return "api";
    case Role::kServe:
      return "serve";
    case Role::kWork:
      return "work";
    default:
      return "all";
  }
}

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_ROLE_H_
