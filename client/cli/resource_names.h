// Names of models, datasets and jobs as people type them, and as the contract wants them.

#ifndef MANEUVER_CLIENT_CLI_RESOURCE_NAMES_H_
#define MANEUVER_CLIENT_CLI_RESOURCE_NAMES_H_

#include <string>
#include <string_view>

namespace maneuver::cli {

// "town", "town@candidate", "town/3" and full names -> models/town, models/town@candidate,
// models/town/versions/3. Empty stays empty: the only serving model.
std::string ModelResource(std::string_view name);
// "town" -> datasets/town.
std::string DatasetResource(std::string_view name);
// "y" -> jobs/y.
std::string JobResource(std::string_view name);

// The other way, for tables: models/town/versions/3 -> town/3, datasets/x -> x, jobs/y -> y.
std::string ShortName(std::string_view resource);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_RESOURCE_NAMES_H_
