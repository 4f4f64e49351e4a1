// Converts names of models, datasets and jobs between the short form that people type and the
// resource names of the contract.

#ifndef MANEUVER_CLIENT_CLI_RESOURCE_NAMES_H_
#define MANEUVER_CLIENT_CLI_RESOURCE_NAMES_H_

#include <string>
#include <string_view>

namespace maneuver::cli {

// Returns a resource name: "town", "town@candidate", "town/3" and full names -> models/town,
// models/town@candidate, models/town/versions/3. An empty name stays empty, which means the only
// serving model.
std::string ModelResource(std::string_view name);
// Returns a resource name: "town" -> datasets/town.
std::string DatasetResource(std::string_view name);
// Returns a resource name: "june" -> tags/june.
std::string TagsResource(std::string_view name);
// Returns a resource name: "y" -> jobs/y.
std::string JobResource(std::string_view name);

// Returns the short form, for tables: models/town/versions/3 -> town/3, datasets/x -> x, jobs/y ->
// y.
std::string ShortName(std::string_view resource);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_RESOURCE_NAMES_H_
