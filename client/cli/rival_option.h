// Parses requirements that compare a version with its rivals.

#ifndef MANEUVER_CLIENT_CLI_RIVAL_OPTION_H_
#define MANEUVER_CLIENT_CLI_RIVAL_OPTION_H_

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "maneuver/v1/rivals.pb.h"

namespace maneuver::cli {

// Explains what ParseRequirements reads, for --help.
inline constexpr char kRivalHelp[] =
    "RIVAL[:METRIC][@strata]. RIVAL is cv (constant velocity), ctra, faded (the faded roll-out), "
    "covernet, multipath, or baselines for those two; METRIC is ade_1 unless given; @strata: also "
    "in every stratum by speed and class with at least 50 examples";

// Appends the requirements that `texts` ask for, such as "cv", "ctra@strata" and
// "baselines:min_fde_6@strata". INVALID_ARGUMENT says what is wrong.
//   flag: the option that the texts come from, for the message
absl::Status ParseRequirements(
    const std::vector<std::string>& texts, v1::RivalStandard standard, const std::string& flag,
    google::protobuf::RepeatedPtrField<v1::RivalRequirement>* requirements);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_RIVAL_OPTION_H_
