#include "server/rpc/prediction_query.h"

#include <set>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"

namespace maneuver::rpc {

absl::StatusOr<serving::DescribeActions> ParseQuery(const v1::DistributionQuery& query,
                                                    int actions) {
  serving::DescribeActions describe;
  switch (query.source()) {
    case v1::LATENT_SOURCE_UNSPECIFIED:
    case v1::LATENT_SOURCE_POSTERIOR:
      describe.source = inference::LatentSource::kPosterior;
      break;
    case v1::LATENT_SOURCE_PRIOR:
      describe.source = inference::LatentSource::kPrior;
      break;
    default:
      return errors::InvalidField("query.source", "no such source of the latent");
  }
  if (!v1::Frame_IsValid(query.frame())) {
    return errors::InvalidField("query.frame", "no such frame");
  }
  if (query.representatives() < 0 || query.representatives() > actions) {
    return errors::InvalidField("query.representatives",
                                absl::StrCat("expected 0 to ", actions, ", as many as actions"));
  }
  describe.representatives = query.representatives();
  if (query.joint_combinations() < 0 ||
      query.joint_combinations() > inference::kMostJointCombinations) {
    return errors::InvalidField("query.joint_combinations",
                                absl::StrCat("expected 0 to ", inference::kMostJointCombinations));
  }
  describe.combinations = query.joint_combinations();
  switch (query.selection_case()) {
    case v1::DistributionQuery::kActionIds: {
      serving::ActionIds chosen;
      std::set<int> seen;
      for (int i = 0; i < query.action_ids().ids_size(); ++i) {
        const int id = query.action_ids().ids(i);
        const std::string field = absl::StrCat("query.action_ids.ids[", i, "]");
        if (id < 0 || id >= actions) {
          return errors::InvalidField(field,
                                      absl::StrCat("the model has the actions 0 to ", actions - 1));
        }
        if (!seen.insert(id).second) return errors::InvalidField(field, "named twice");
        chosen.ids.push_back(id);
      }
      if (chosen.ids.empty()) {
        return errors::InvalidField("query.action_ids.ids", "name at least one action");
      }
      describe.selection = std::move(chosen);
      break;
    }
    case v1::DistributionQuery::kMinProbability:
      if (!(query.min_probability() >= 0.0 && query.min_probability() <= 1.0)) {
        return errors::InvalidField("query.min_probability", "expected 0 to 1");
      }
      describe.selection = serving::AtLeast{query.min_probability()};
      break;
    case v1::DistributionQuery::kTopK:
      if (query.top_k() < 1) return errors::InvalidField("query.top_k", "expected at least 1");
      describe.selection = serving::TopK{query.top_k()};
      break;
    case v1::DistributionQuery::SELECTION_NOT_SET:
      describe.selection = serving::AtLeast{};
      break;
  }
  return describe;
}

absl::StatusOr<serving::Priority> ParsePriority(v1::Priority priority) {
  switch (priority) {
    case v1::PRIORITY_UNSPECIFIED:
    case v1::PRIORITY_INTERACTIVE:
      return serving::Priority::kInteractive;
    case v1::PRIORITY_BULK:
      return serving::Priority::kBulk;
    default:
      return errors::InvalidField("priority", "no such priority");
  }
}

}  // namespace maneuver::rpc
