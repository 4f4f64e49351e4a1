// A store of aliases for tests, in place of a database.

#ifndef MANEUVER_TESTS_UNIT_SERVER_SERVING_MEMORY_ALIAS_STORE_H_
#define MANEUVER_TESTS_UNIT_SERVER_SERVING_MEMORY_ALIAS_STORE_H_

#include <map>

#include "server/errors/error_details.h"
#include "server/serving/alias_store.h"

namespace maneuver::serving {

// Aliases in memory. Not thread-safe. While `broken` or `away` is set, SetAliasIf fails as with a
// full disk or a database that cannot be reached.
class MemoryAliasStore final : public AliasStore {
 public:
  absl::StatusOr<bool> SetAliasIf(const security::ModelAliasName& name, int version,
                                  const AliasCondition& condition) override {
    if (broken) return absl::UnavailableError("disk full");
    if (away) {
      return errors::WithReason(absl::UnavailableError("no connection"), "STORE_UNAVAILABLE");
    }
    const auto found = aliases.find(name);
    const int before = found == aliases.end() ? 0 : found->second;
    if (condition.before.value_or(before) != before) return false;
    aliases[name] = version;
    return true;
  }
  absl::StatusOr<int> GetAlias(const security::ModelAliasName& name) override {
    const auto found = aliases.find(name);
    if (found == aliases.end()) return absl::NotFoundError("no alias");
    return found->second;
  }
  absl::StatusOr<std::vector<ModelAlias>> ListAliases() override {
    std::vector<ModelAlias> all;
    for (const auto& [name, version] : aliases) all.push_back({name, version});
    return all;
  }
  absl::Status DeleteAlias(const security::ModelAliasName& name) override {
    return aliases.erase(name) == 1 ? absl::OkStatus() : absl::NotFoundError("no alias");
  }

  std::map<security::ModelAliasName, int> aliases;
  bool broken = false;
  bool away = false;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_TESTS_UNIT_SERVER_SERVING_MEMORY_ALIAS_STORE_H_
