#include "server/serving/version_description.h"

#include <string>
#include <utility>

namespace maneuver::serving {

absl::StatusOr<v1::ModelVersion> DescribeVersion(const VersionStore& store,
                                                 const ServingTable& table,
                                                 const security::ModelVersionName& name) {
  absl::StatusOr<v1::ModelVersion> version = store.Describe(name);
  if (!version.ok()) return version;
  for (std::string& alias : table.AliasesOf(name)) version->add_aliases(std::move(alias));
  return version;
}

}  // namespace maneuver::serving
