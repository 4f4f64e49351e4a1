// Stores the aliases of models across restarts.

#ifndef MANEUVER_SERVER_SERVING_ALIAS_STORE_H_
#define MANEUVER_SERVER_SERVING_ALIAS_STORE_H_

#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/security/resource_name.h"
#include "server/serving/maker.h"

namespace maneuver::serving {

struct ModelAlias {
  security::ModelAliasName name;
  int version = 0;
};

// What must hold when an alias is moved.
struct AliasCondition {
  // The version that the alias points to; 0: there is no such alias. Empty: any.
  std::optional<int> before;
  Maker maker;  // if it has a lease, the lease must not have ended
};

// A change is durable once its call has returned OK. Safe to use from any thread.
class AliasStore {
 public:
  virtual ~AliasStore() = default;

  // Creates or moves an alias.
  absl::Status SetAlias(const security::ModelAliasName& name, int version) {
    return SetAliasIf(name, version, {}).status();
  }
  // Creates or moves an alias and returns true. Returns false, and changes nothing, if the alias
  // points elsewhere than to `condition.before`. ABORTED if the maker's lease has ended; NOT_FOUND
  // if several servers share the store and the version does not exist.
  virtual absl::StatusOr<bool> SetAliasIf(const security::ModelAliasName& name, int version,
                                          const AliasCondition& condition) = 0;
  // Returns the version that an alias points to. NOT_FOUND if there is no such alias.
  virtual absl::StatusOr<int> GetAlias(const security::ModelAliasName& name) = 0;
  virtual absl::StatusOr<std::vector<ModelAlias>> ListAliases() = 0;
  // Deletes an alias. NOT_FOUND if there is no such alias.
  virtual absl::Status DeleteAlias(const security::ModelAliasName& name) = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_ALIAS_STORE_H_
