// Who may call what: one table over every method of every service.

#ifndef MANEUVER_SERVER_SECURITY_ROLES_H_
#define MANEUVER_SERVER_SECURITY_ROLES_H_

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace maneuver::security {

// Roles do not contain one another: who trains and asks has both.
enum class Role {
  kAnyone = 0,   // in the table alone: no identity is asked for
  kPredict = 1,  // ask, and see which models there are
  kTrain = 2,    // bring data, learn, measure, name actions, take models away
  kAdmin = 4,    // delete, bring models, and say which version serves
};

std::string_view ToString(Role role);

// Any of predict, train and admin.
class RoleSet {
 public:
  // "predict" or "predict,train". INVALID_ARGUMENT for an unknown one, or none.
  static absl::StatusOr<RoleSet> Parse(std::string_view text);

  bool Contains(Role role) const { return (bits_ & static_cast<unsigned>(role)) != 0; }
  void Add(Role role) { bits_ |= static_cast<unsigned>(role); }
  // As Parse reads it.
  std::string ToString() const;

 private:
  unsigned bits_ = 0;
};

struct MethodRole {
  std::string_view method;  // "/maneuver.v1.PredictionService/Predict"
  Role role;
};

// The table.
std::span<const MethodRole> MethodRoles();

// The role that a method needs. Nothing for a method without a row, which nobody may call.
std::optional<Role> RequiredRole(std::string_view method);

}  // namespace maneuver::security

#endif  // MANEUVER_SERVER_SECURITY_ROLES_H_
