// Describes a version to callers.

#ifndef MANEUVER_SERVER_SERVING_VERSION_DESCRIPTION_H_
#define MANEUVER_SERVER_SERVING_VERSION_DESCRIPTION_H_

#include "absl/status/statusor.h"
#include "maneuver/v1/model_service.pb.h"
#include "server/security/resource_name.h"
#include "server/serving/serving_table.h"
#include "server/serving/version_store.h"

namespace maneuver::serving {

// Returns what is stored of a version, with the aliases that name it. Errors are those of
// VersionStore::Describe.
absl::StatusOr<v1::ModelVersion> DescribeVersion(const VersionStore& store,
                                                 const ServingTable& table,
                                                 const security::ModelVersionName& name);

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_VERSION_DESCRIPTION_H_
