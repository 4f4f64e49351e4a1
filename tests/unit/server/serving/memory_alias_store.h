#ifndef MANEUVER_TESTS_UNIT_SERVER_SERVING_MEMORY_ALIAS_STORE_H_
#define MANEUVER_TESTS_UNIT_SERVER_SERVING_MEMORY_ALIAS_STORE_H_

#include <map>

#include "server/errors/error_details.h"
#include "server/serving/alias_store.h"

namespace maneuver::serving {

class MemoryAliasStore final : public AliasStore {
 public:
  absl::Status SetAlias(const security::ModelAliasName& name, int version) override {
    if (broken) return absl::UnavailableError("disk full");
    if (away) {
      return errors::WithReason(absl::UnavailableError("no connection"), "STORE_UNAVAILABLE");
    }
    aliases[name] = version;
    return absl::OkStatus();
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
