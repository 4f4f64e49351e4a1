// Says which role may call which method: one table of all methods of all services.

#ifndef MANEUVER_SERVER_SECURITY_ROLES_H_
#define MANEUVER_SERVER_SECURITY_ROLES_H_

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace maneuver::security {

// Roles do not include one another: a caller that trains and predicts has both.
enum class Role {
  kAnyone = 0,   // only in the table: no identity is required
  kPredict = 1,  // predict, report outcomes, and read what models and reports say
  kTrain = 2,    // upload data, train, evaluate, tag, label actions, download models
  // Delete, upload models, set aliases, register folders, read and change the log level.
  kAdmin = 4,
};

std::string_view ToString(Role role);

// A set of the roles predict, train and admin.
class RoleSet {
 public:
  // Parses "predict" or "predict,train". INVALID_ARGUMENT for an unknown role, or for none.
  static absl::StatusOr<RoleSet> Parse(std::string_view text);

  bool Contains(Role role) const { return (bits_ & static_cast<unsigned>(role)) != 0; }
  void Add(Role role) { bits_ |= static_cast<unsigned>(role); }
  // Returns the text that Parse reads.
  std::string ToString() const;

 private:
  unsigned bits_ = 0;
};

struct MethodRole {
  std::string_view method;  // "/maneuver.v1.PredictionService/Predict"
  Role role;
};

// Returns the table of all methods.
std::span<const MethodRole> MethodRoles();

// Returns the role that a method needs. A method without a row has none, and nobody may call it.
std::optional<Role> RequiredRole(std::string_view method);

}  // namespace maneuver::security

#endif  // MANEUVER_SERVER_SECURITY_ROLES_H_
