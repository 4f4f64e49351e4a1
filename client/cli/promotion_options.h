// The options that say when a new version serves.

#ifndef MANEUVER_CLIENT_CLI_PROMOTION_OPTIONS_H_
#define MANEUVER_CLIENT_CLI_PROMOTION_OPTIONS_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/cli/command.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::cli {

struct PromotionArguments {
  std::string promote = "auto";
  std::optional<std::string> dataset;
  std::vector<std::string> metrics;
  std::vector<std::string> ahead;
  std::vector<std::string> not_behind;
};

// Adds --promote and --promote-... to a command. `arguments` must outlive it.
void AddPromotionOptions(Command& command, PromotionArguments* arguments);

// Writes the promotion, and its criteria if it has some. INVALID_ARGUMENT says what is wrong with
// the options.
absl::Status ReadPromotion(const PromotionArguments& arguments, v1::Promotion* promotion,
                           std::optional<v1::PromotionCriteria>* criteria);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_PROMOTION_OPTIONS_H_
