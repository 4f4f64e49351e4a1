#include "client/cli/promotion_options.h"

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "client/cli/resource_names.h"
#include "client/cli/rival_option.h"

namespace maneuver::cli {
namespace {

v1::Promotion PromotionOf(const std::string& choice) {
  if (choice == "always") return v1::PROMOTION_ALWAYS;
  if (choice == "never") return v1::PROMOTION_NEVER;
  return choice == "if-no-worse" ? v1::PROMOTION_IF_NO_WORSE : v1::PROMOTION_UNSPECIFIED;
}

absl::Status ReadCriteria(const PromotionArguments& arguments, v1::PromotionCriteria* criteria) {
  if (!arguments.dataset) {
    return absl::InvalidArgumentError(
        "--promote if-no-worse needs --promote-dataset, the dataset to measure both versions on");
  }
  criteria->set_dataset(DatasetResource(*arguments.dataset));
  for (const std::string& text : arguments.metrics) {
    v1::MetricCriterion& criterion = *criteria->add_metrics();
    const size_t equals = text.find('=');
    criterion.set_metric(text.substr(0, equals));
    if (equals == std::string::npos) continue;
    double tolerance = 0.0;
    if (!absl::SimpleAtod(text.substr(equals + 1), &tolerance)) {
      return absl::InvalidArgumentError(
          absl::StrCat("--promote-metric is NAME or NAME=TOLERANCE, such as nll=0.01; not ", text));
    }
    criterion.set_tolerance(tolerance);
  }
  absl::Status status = ParseRequirements(arguments.ahead, v1::RIVAL_STANDARD_AHEAD,
                                          "--promote-ahead", criteria->mutable_rivals());
  status.Update(ParseRequirements(arguments.not_behind, v1::RIVAL_STANDARD_NOT_BEHIND,
                                  "--promote-not-behind", criteria->mutable_rivals()));
  return status;
}

}  // namespace

void AddPromotionOptions(Command& command, PromotionArguments* arguments) {
  command.Choice("--promote", &arguments->promote, {"auto", "never", "always", "if-no-worse"},
                 "Whether the new version serves; auto: if none serves yet; if-no-worse: if none "
                 "serves yet or it is no worse on --promote-dataset, and it meets --promote-ahead "
                 "and --promote-not-behind");
  command.Option("--promote-dataset", &arguments->dataset,
                 "Dataset to measure both versions on, for if-no-worse");
  command.Option("--promote-metric", &arguments->metrics,
                 "NAME or NAME=TOLERANCE, such as nll=0.01, that may not be worse; may be repeated "
                 "[min_ade_6 nll]");
  command.Option("--promote-ahead", &arguments->ahead,
                 absl::StrCat("Require that the new version is ahead of this on --promote-dataset "
                              "by the whole 95 % interval of the difference; may be repeated. ",
                              kRivalHelp));
  command.Option(
      "--promote-not-behind", &arguments->not_behind,
      "Require that the new version is not behind this by the whole interval; undecided is enough");
}

absl::Status ReadPromotion(const PromotionArguments& arguments, v1::Promotion* promotion,
                           std::optional<v1::PromotionCriteria>* criteria) {
  *promotion = PromotionOf(arguments.promote);
  if (*promotion == v1::PROMOTION_IF_NO_WORSE) {
    return ReadCriteria(arguments, &criteria->emplace());
  }
  const bool given = arguments.dataset || !arguments.metrics.empty() || !arguments.ahead.empty() ||
                     !arguments.not_behind.empty();
  return given ? absl::InvalidArgumentError(
                     "--promote-dataset, --promote-metric, --promote-ahead and "
                     "--promote-not-behind need --promote if-no-worse")
               : absl::OkStatus();
}

}  // namespace maneuver::cli
