// Turns the shares of found rows into a picture.

#ifndef MANEUVER_CLIENT_CLI_FOUND_SHARES_H_
#define MANEUVER_CLIENT_CLI_FOUND_SHARES_H_

#include <string>
#include <vector>

#include "client/plot/share_plot.h"
#include "model/tags/tag_query.h"

namespace maneuver::cli {

// Returns the names of all parts of the answers, in the order in which they are shown.
std::vector<std::string> PartNames(const tags::Found& found, const tags::Found* against);

// Returns the part of an answer; one without rows if there is none.
const tags::Statistics& PartOf(const tags::Found& found, const std::string& part);

// Returns the picture of the groups, in a panel for each part; without parts in one. Queries must
// have `errors`. Leaves out the rarest groups and the smallest parts beyond what a picture holds.
//   by, per: what the groups and the parts are, as the options name them; per may be empty
//   name, other: of the two answers; other: unused without `against`
plot::SharePlot SharePlotOf(const tags::Found& found, const tags::Found* against,
                            const std::string& by, const std::string& per, const std::string& name,
                            const std::string& other);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_FOUND_SHARES_H_
