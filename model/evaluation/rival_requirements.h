// Checks what a version must show against its rivals before it is promoted.

#ifndef MANEUVER_MODEL_EVALUATION_RIVAL_REQUIREMENTS_H_
#define MANEUVER_MODEL_EVALUATION_RIVAL_REQUIREMENTS_H_

#include <string>
#include <vector>

#include "maneuver/v1/rivals.pb.h"

namespace maneuver::evaluation {

using RivalRequirements = google::protobuf::RepeatedPtrField<v1::RivalRequirement>;

// What is wrong with a requirement: the field and a description, such as "rival", "is ...". Both
// are empty if nothing is wrong.
struct RequirementFault {
  std::string field;
  std::string description;
};
RequirementFault CheckRequirement(const v1::RivalRequirement& requirement);

// Returns where a version does not meet the requirements, in their order; empty if it meets all.
// Passes over strata of fewer than kLeastComparedExamples examples. If there are too few examples
// in total, or the version was not compared with that rival, the shortfall has no comparison.
//   requirements: CheckRequirement must find no fault in them.
std::vector<v1::RivalShortfall> FindShortfalls(const v1::RivalStandings& standings,
                                               const RivalRequirements& requirements);

// Returns one part of a sentence per requirement that is not met, joined by "; ", such as
//   "not ahead of constant velocity by ade_1 in stationary (+0.012 m, 95 % +0.003 .. +0.020)".
std::string ShortfallText(const std::vector<v1::RivalShortfall>& shortfalls);

// Prints a requirement for people: "ahead of constant velocity by ade_1 in every stratum".
std::string RequirementText(const v1::RivalRequirement& requirement);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_RIVAL_REQUIREMENTS_H_
